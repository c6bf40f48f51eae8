// SPDX-License-Identifier: GPL-3.0-or-later
#include <gmock/gmock.h>
#include <unistd.h>

#include <fstream>
#include <iterator>
#include <telefab/base/damaged_file.hpp>
#include <telefab/test/scratch_folder.hpp>

namespace telefab {
namespace {

namespace fs = std::filesystem;

class DamagedFile : public testing::Test {
 protected:
  DamagedFile() { std::ofstream{path()} << "what is left"; }
  [[nodiscard]] fs::path path() const { return folder / "journal"; }
  [[nodiscard]] static std::string text_of(const fs::path& file) {
    std::ifstream in{file};
    return {std::istreambuf_iterator<char>{in}, {}};
  }
  test::ScratchFolder scratch;
  fs::path folder = scratch.path();
};

TEST_F(DamagedFile, IsKeptUnderTheFirstNameThatNothingHas) {
  EXPECT_EQ(name_for_damaged(path()).value(), folder / "journal.damaged-1");
  fs::create_directory(folder / "journal.damaged-1");
  // A link that leads nowhere is something all the same: what is written to it would lie elsewhere.
  fs::create_symlink("/nowhere", folder / "journal.damaged-2");
  EXPECT_EQ(name_for_damaged(path()).value(), folder / "journal.damaged-3");
}

TEST_F(DamagedFile, IsCopiedAsOftenAsItIsFoundDamagedAndStaysItself) {
  EXPECT_EQ(copy_damaged(path()).value(), folder / "journal.damaged-1");
  std::ofstream{path()} << "another";
  EXPECT_EQ(copy_damaged(path()).value(), folder / "journal.damaged-2");
  EXPECT_EQ(text_of(folder / "journal.damaged-1"), "what is left");
  EXPECT_EQ(text_of(folder / "journal.damaged-2"), "another");
  EXPECT_EQ(text_of(path()), "another");
  EXPECT_EQ(std::distance(fs::directory_iterator{folder}, fs::directory_iterator{}), 3);
}

TEST_F(DamagedFile, ThatCannotBeReadLeavesNoCopy) {
  fs::remove(path());
  const auto kept = copy_damaged(path());
  ASSERT_FALSE(kept);
  EXPECT_EQ(kept.error().code, ErrorCode::StorageFailed);
  EXPECT_THAT(kept.error().what, testing::HasSubstr("cannot be kept aside"));
  EXPECT_TRUE(fs::is_empty(folder));
}

}  // namespace
}  // namespace telefab
