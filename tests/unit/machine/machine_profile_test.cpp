#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <cstdlib>
#include <telefab/machine/machine_profile.hpp>

namespace telefab {
namespace {

using testing::HasSubstr;

std::vector<MachineProfile> shipped() {
  return load_machine_profiles(std::string{std::getenv("TELEFAB_SOURCE")} + "/deploy/config/machines").value();
}

TEST(MachineProfile, HasThePixelsOfThePapersMachines) {  // paper, Table 1; floor(platform / pitch)
  const auto machines = shipped();
  EXPECT_EQ(find_machine(machines, "machine-a")->mask_size(), (PixelSize{1857, 1142}));
  EXPECT_EQ(find_machine(machines, "machine-b")->mask_size(), (PixelSize{1021, 765}));
  EXPECT_EQ(find_machine(machines, "machine-c")->mask_size(), (PixelSize{1000, 750}));
  EXPECT_EQ(find_machine(machines, "dlp6500")->mask_size(), (PixelSize{1920, 1080}));
}

TEST(MachineProfile, ComesBackFromItsOwnText) {
  for (const MachineProfile& machine : shipped())
    EXPECT_EQ(machine_profile_from_toml(to_toml(machine), "text").value(), machine);
}

TEST(MachineProfile, NamesTheLineOfAnUnknownKey) {
  const auto profile = machine_profile_from_toml("name = \"x\"\n[layers]\nthickness_um = 3\n", "x.toml");
  ASSERT_FALSE(profile);
  EXPECT_THAT(profile.error().what, HasSubstr("x.toml, line 3"));
  EXPECT_THAT(profile.error().what, HasSubstr("layers.thickness_um"));
}

TEST(MachineProfile, RefusesValuesOutOfRangeNotFiniteOrOfTheWrongType) {
  const std::string good = to_toml(shipped().front());
  for (const char* bad : {"thickness_mm = 0.0", "thickness_mm = nan", "thickness_mm = \"0.1\"", "thickness_mm = -1",
                          "bottom_count = 2.5"}) {
    std::string text = good;
    const std::string key{bad, std::string_view{bad}.find(' ')};
    const auto at = text.find(key + " =");
    text.replace(at, text.find('\n', at) - at, bad);
    EXPECT_FALSE(machine_profile_from_toml(text, "x.toml")) << bad;
  }
}

TEST(MachineProfile, SaysWhichRequiredKeyIsMissing) {
  const auto profile = machine_profile_from_toml("name = \"x\"\n", "x.toml");
  ASSERT_FALSE(profile);
  EXPECT_THAT(profile.error().what, HasSubstr("platform.width_mm is missing"));
}

}  // namespace
}  // namespace telefab
