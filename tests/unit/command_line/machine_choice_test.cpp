// SPDX-License-Identifier: GPL-3.0-or-later
#include <gmock/gmock.h>
#include <stdlib.h>
#include <unistd.h>

#include <fstream>
#include <telefab/command_line/machine_choice.hpp>
#include <telefab/test/scratch_folder.hpp>

namespace telefab {
namespace {

namespace fs = std::filesystem;
using testing::ElementsAre;
using testing::HasSubstr;

TEST(MachineFolders, AreLookedAtFromTheUsersOwnToTheCheckout) {
  EXPECT_THAT(machine_folders({"/cfg", "/usr/bin/telefab-scan", "/etc"}),
              ElementsAre("/cfg/telefab/machines", "/etc/telefab/machines", "/usr/share/telefab/machines",
                          "/usr/bin/machines", "deploy/config/machines"));
  EXPECT_THAT(machine_folders({"", "", "/etc"}), ElementsAre("/etc/telefab/machines", "deploy/config/machines"));
}

class MachineChoiceTest : public testing::Test {
 protected:
  void SetUp() override { setenv("XDG_CONFIG_HOME", root_.c_str(), 1); }
  void TearDown() override { unsetenv("XDG_CONFIG_HOME"); }
  /// A profile of that name in the folder.
  static void keep(const fs::path& folder, const std::string& name) {
    fs::create_directories(folder);
    MachineProfile machine = find_machine(builtin_profiles()->machines(), "dlp6500").value();
    machine.name = name;
    std::ofstream{folder / (name + ".toml")} << to_toml(machine);
  }
  test::ScratchFolder scratch_;
  fs::path root_ = scratch_.path();
};

TEST_F(MachineChoiceTest, TakesTheUsersOwnProfilesAndNoOthersBesideThem) {
  keep(root_ / "telefab/machines", "mine");
  const auto known = known_profiles("");
  ASSERT_TRUE(known) << known.error().what;
  EXPECT_EQ(known->origin, (root_ / "telefab/machines").string());
  ASSERT_EQ(known->catalogue.machines().size(), 1U);
  EXPECT_EQ(chosen_machine({"mine", ""})->name, "mine");
  EXPECT_THAT(chosen_machine({"machine-a", ""}).error().what, HasSubstr(known->origin));
}

TEST_F(MachineChoiceTest, PassesOverAFolderWithoutProfilesButNotOverABadOne) {
  fs::create_directories(root_ / "telefab/machines");
  const auto passed = known_profiles("");
  ASSERT_TRUE(passed) << passed.error().what;
  EXPECT_NE(passed->origin, (root_ / "telefab/machines").string());
  std::ofstream{root_ / "telefab/machines/bad.toml"} << "name = 3\n";
  EXPECT_FALSE(known_profiles(""));
}

TEST_F(MachineChoiceTest, PassesOverAHomeThatIsAnotherUsers) {
  keep(root_ / "telefab/machines", "mine");
  fs::permissions(root_, fs::perms::none);
  const bool is_root = geteuid() == 0;
  if (is_root) {
    ASSERT_EQ(seteuid(65534), 0);
  }
  const auto passed = known_profiles("");
  if (is_root) {
    ASSERT_EQ(seteuid(0), 0);
  }
  fs::permissions(root_, fs::perms::owner_all);
  ASSERT_TRUE(passed) << passed.error().what;
  EXPECT_NE(passed->origin, (root_ / "telefab/machines").string());
}

TEST_F(MachineChoiceTest, AFolderThatIsNamedIsTheOnlyOneThereIs) {
  keep(root_ / "telefab/machines", "mine");
  keep(root_ / "given", "theirs");
  EXPECT_EQ(known_profiles((root_ / "given").string())->catalogue.machines().front().name, "theirs");
  EXPECT_EQ(known_profiles((root_ / "nowhere").string()).error().code, ErrorCode::NotFound);
}

TEST_F(MachineChoiceTest, TheNameOfTheCommandLineGoesBeforeThatOfTheInput) {
  keep(root_ / "given", "one");
  keep(root_ / "given", "two");
  const std::string folder = (root_ / "given").string();
  EXPECT_EQ(chosen_machine({"", folder}, "one")->name, "one");
  EXPECT_EQ(chosen_machine({"two", folder}, "one")->name, "two");
  EXPECT_EQ(chosen_machine({"", folder}).error().code, ErrorCode::InvalidInput);
}

}  // namespace
}  // namespace telefab
