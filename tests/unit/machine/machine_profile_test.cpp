// SPDX-License-Identifier: GPL-3.0-or-later
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <cmath>
#include <cstdlib>
#include <fstream>
#include <sstream>
#include <telefab/machine/profile_catalogue.hpp>
#include <telefab/machine/profile_digest.hpp>
#include <telefab/machine/profile_reference.hpp>

namespace telefab {
namespace {

using testing::HasSubstr;
using testing::Not;

std::vector<MachineProfile> shipped() {
  return load_profiles(std::string{std::getenv("TELEFAB_SOURCE")} + "/deploy/config/machines")->machines();
}

/// One that states most of what it has itself.
MachineProfile whole() { return find_machine(shipped(), "dlp6500").value(); }

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

TEST(MachineProfile, BuiltInOnesAreThoseOfTheFolder) {
  const auto builtin = builtin_profiles();
  ASSERT_TRUE(builtin) << builtin.error().what;
  EXPECT_EQ(builtin->machines(), shipped());
}

TEST(MachineProfile, CarriesByStrengthSafetyAndPullAndAsAssumedWhereItDoesNotSay) {
  MachineProfile machine = whole();
  EXPECT_DOUBLE_EQ(machine.carried_demand(), 125);
  EXPECT_DOUBLE_EQ(machine.pull_of_film_kpa(), 20);
  EXPECT_FALSE(machine.states_what_carries());
  machine.motion.pull_kpa = 50;
  EXPECT_FALSE(machine.states_what_carries());
  EXPECT_DOUBLE_EQ(machine.carried_demand(), 50);
  machine.resin.green_strength_mpa = 40, machine.supports.safety = 4, machine.supports.fresh_share = 1;
  EXPECT_DOUBLE_EQ(machine.carried_demand(), 200);
  EXPECT_TRUE(machine.states_what_carries());
  EXPECT_EQ(machine_profile_from_toml(to_toml(machine), "text").value(), machine);
  for (const char* assumed :
       {"resin.green_strength_mpa", "supports.safety", "supports.fresh_share", "motion.pull_kpa"}) {
    const std::string keys = describe_keys();
    const std::string line = keys.substr(keys.find(assumed), keys.find('\n', keys.find(assumed)) - keys.find(assumed));
    EXPECT_THAT(line, HasSubstr("assumed"));
  }
}

TEST(MachineProfile, MovesAndLightsAsBeforeWhereItStatesNothingElse) {
  for (const MachineProfile& machine : shipped()) {
    for (const std::uint32_t layer : {0U, 1U, 5U, 100U}) {
      const auto& layers = machine.layers;
      EXPECT_EQ(machine.exposure_of_layer_s(layer),
                layer < layers.bottom_count ? layers.bottom_exposure_s : layers.exposure_s);
      EXPECT_EQ(machine.light_share_of_layer(layer), 1);
    }
    EXPECT_EQ(machine.at_full_light(), machine);
    EXPECT_EQ(machine.highest_lift_mm(), machine.motion.lift_mm);
    EXPECT_EQ(machine.motion.stroke_of(true, true), machine.motion.stroke_of(false, false));
  }
}

MachineProfile fading() {
  MachineProfile machine = shipped().front();
  machine.layers.bottom_count = 2;
  machine.layers.bottom_exposure_s = 20;
  machine.layers.exposure_s = 2;
  machine.layers.transition_count = 5;
  return machine;
}

TEST(MachineProfile, LetsExposuresFallInEvenStepsFromBottomToNormal) {
  const double expected[] = {20, 20, 17, 14, 11, 8, 5, 2, 2};
  for (std::uint32_t layer = 0; layer < std::size(expected); ++layer)
    EXPECT_DOUBLE_EQ(fading().exposure_of_layer_s(layer), expected[layer]) << layer;
}

TEST(MachineProfile, HasTheSameDosesAtFullLight) {
  MachineProfile machine = fading();
  machine.layers.light_share = 0.4;
  machine.layers.bottom_light_share = 0.9;
  const MachineProfile full = machine.at_full_light();
  EXPECT_EQ(full.at_full_light(), full);
  for (std::uint32_t layer = 0; layer < 10; ++layer) {
    EXPECT_EQ(full.light_share_of_layer(layer), 1);
    EXPECT_DOUBLE_EQ(full.exposure_of_layer_s(layer),
                     machine.exposure_of_layer_s(layer) * machine.light_share_of_layer(layer));
  }
  const double step = full.exposure_of_layer_s(3) - full.exposure_of_layer_s(2);
  EXPECT_NEAR(full.exposure_of_layer_s(2) - full.exposure_of_layer_s(1), step, 1e-9) << "doses fall evenly";
}

TEST(MachineProfile, RefusesMotionsThatCannotBeMadeAndNamesTheirKeys) {
  const auto refused = [](auto change) {
    MachineProfile machine = shipped().front();
    change(machine.motion);
    const auto read = machine_profile_from_toml(to_toml(machine), "file.toml");
    return read ? std::string{} : read.error().what;
  };
  using Motion = MachineProfile::Motion;
  EXPECT_EQ(refused([](Motion& m) { m.peel_mm = 1, m.peel_speed_mm_per_s = 0.5, m.bottom.peel_mm = 3; }), "");
  EXPECT_EQ(refused([](Motion& m) { m.lift_mm = 0, m.tilt_s = 5, m.large_area_mm2 = 9, m.large.tilt_s = 8; }), "");
  EXPECT_THAT(refused([](Motion& m) { m.lift_mm = 0; }), HasSubstr("motion.lift_mm nor motion.tilt_s"));
  EXPECT_THAT(refused([](Motion& m) { m.peel_mm = 1; }), HasSubstr("motion.peel_speed_mm_per_s must be stated"));
  EXPECT_THAT(refused([](Motion& m) { m.approach_mm = 1; }),
              HasSubstr("motion.approach_speed_mm_per_s must be stated"));
  EXPECT_THAT(refused([](Motion& m) { m.peel_speed_mm_per_s = 1, m.bottom.peel_mm = 90; }),
              HasSubstr("of a bottom layer motion.peel_mm is 90 mm"));
  EXPECT_THAT(refused([](Motion& m) { m.large_area_mm2 = 5, m.large.approach_mm = 1; }), HasSubstr("a large layer"));
}

/// The profile with one line of a section put in or changed.
std::string with(std::string toml, std::string_view section, std::string_view key, std::string_view word) {
  const std::string line = "\n" + std::string{key} + " = ";
  const auto from = toml.find("[" + std::string{section} + "]");
  const auto at = toml.find(line, from);
  const auto end = toml.find('\n', at + 1);
  return toml.replace(at, end - at, line + "\"" + std::string{word} + "\"");
}

template <MachineWord Word, class Section>
void takes_its_words_and_no_others(std::string_view section, std::string_view key, Section MachineProfile::*part,
                                   Word Section::*field) {
  MachineProfile machine = whole();
  machine.*part.*field = static_cast<Word>(1);  // some are written only where they are not the first
  const std::string toml = to_toml(machine);
  for (std::size_t i = 0; i < kMachineWords<Word>.size(); ++i) {
    const auto read = machine_profile_from_toml(with(toml, section, key, kMachineWords<Word>[i]), "text");
    ASSERT_TRUE(read) << read.error().what;
    EXPECT_EQ(static_cast<std::size_t>((*read).*part.*field), i) << key;
    EXPECT_EQ(machine_profile_from_toml(to_toml(*read), "text").value(), *read) << key;
  }
  // Once a text that nobody knew went all the way to the driver, which took it for "normal".
  for (const char* unknown : {"", "upside-down", "Normal", "normal "}) {
    const auto refused = machine_profile_from_toml(with(toml, section, key, unknown), "text");
    ASSERT_FALSE(refused) << key << ' ' << unknown;
    EXPECT_THAT(refused.error().what, HasSubstr(std::string{section} + "." + std::string{key}));
    EXPECT_THAT(refused.error().what, HasSubstr(std::string{kMachineWords<Word>.back()}));
  }
  EXPECT_FALSE(machine_word_from<Word>("upside-down"));
}

TEST(MachineProfile, OfAPrinterThatTakesNoFileHasTheTextAndTheDigestItEverHad) {
  MachineProfile machine = whole();
  EXPECT_THAT(to_toml(machine), testing::Not(HasSubstr("[file]")));
  const Digest before = digest_of_profile(machine);
  machine.file = {PrinterFile::Goo, "ELEGOO Mars", "", FadeReader::Odyssey, 0.1};
  EXPECT_THAT(to_toml(machine), HasSubstr("[file]\nkind = \"goo\"\n"));
  EXPECT_EQ(digest_of_profile(machine), before) << "what a fab hands to its printer is its own matter";
}

TEST(MachineProfile, RefusesAWholePrinterWithoutTheFileThatItTakes) {
  MachineProfile machine = whole();
  machine.devices.printer = PrinterKind::Sdcp;
  const auto refused = machine_profile_from_toml(to_toml(machine), "file.toml");
  ASSERT_FALSE(refused);
  EXPECT_THAT(refused.error().what, HasSubstr("file.kind"));
  machine.file.kind = PrinterFile::Goo;
  EXPECT_EQ(machine_profile_from_toml(to_toml(machine), "file.toml").value(), machine);
}

TEST(MachineProfile, TakesTheWordsOfEachEnumerationAndNoOthers) {
  using P = MachineProfile;
  takes_its_words_and_no_others("projection", "orientation", &P::projection, &P::Projection::orientation);
  takes_its_words_and_no_others("projection", "controllers", &P::projection, &P::Projection::controllers);
  takes_its_words_and_no_others("devices", "projector", &P::devices, &P::Devices::projector);
  takes_its_words_and_no_others("devices", "stage", &P::devices, &P::Devices::stage);
  takes_its_words_and_no_others("devices", "led_colour", &P::devices, &P::Devices::led_colour);
  takes_its_words_and_no_others("devices", "led_polarity", &P::devices, &P::Devices::led_polarity);
  takes_its_words_and_no_others("devices", "led_off", &P::devices, &P::Devices::led_off);
  takes_its_words_and_no_others("devices", "led_cutoff", &P::devices, &P::Devices::led_cutoff);
  takes_its_words_and_no_others("devices", "thermometer", &P::devices, &P::Devices::thermometer);
  takes_its_words_and_no_others("devices", "light", &P::devices, &P::Devices::light);
  takes_its_words_and_no_others("screen", "rotation", &P::screen, &P::Screen::rotation);
  takes_its_words_and_no_others("screen", "packing", &P::screen, &P::Screen::packing);
  takes_its_words_and_no_others("light", "command", &P::light, &P::Light::command);
  takes_its_words_and_no_others("file", "kind", &P::file, &P::File::kind);
  takes_its_words_and_no_others("file", "fade", &P::file, &P::File::fade);
}

TEST(MachineProfile, KeepsAMeasuredCurveAndField) {
  MachineProfile machine = whole();
  machine.projection.curve = {0, 0.125, 0.125, 1};
  machine.projection.field = {{0.75, 1}, {0.5, 0.8125}, {0.0625, 1}};
  EXPECT_EQ(machine_profile_from_toml(to_toml(machine), "text").value(), machine);
}

TEST(MachineProfile, TonesFollowGammaOrTheMeasuredCurveAboveTheLeak) {
  MachineProfile::Projection projection;
  projection.gamma = 2;
  projection.leak = 0.1;
  EXPECT_DOUBLE_EQ(tone_of(projection)[0], 0.1);
  EXPECT_DOUBLE_EQ(tone_of(projection)[51], 0.1 + 0.9 * 0.04);
  EXPECT_DOUBLE_EQ(tone_of(projection)[255], 1);
  projection.curve = {0, 0.5, 0.5, 1};
  EXPECT_DOUBLE_EQ(tone_of(projection)[85], 0.1 + 0.9 * 0.5);
  EXPECT_DOUBLE_EQ(tone_of(projection)[34], 0.1 + 0.9 * 0.2);
  EXPECT_DOUBLE_EQ(tone_of(projection)[255], 1);
}

TEST(MachineProfile, FieldIsBilinearBetweenTheMiddlesOfItsCells) {
  MachineProfile::Projection projection;
  EXPECT_EQ(field_at(projection, 0.3, 0.9), 1);
  projection.field = {{1, 0.8}, {0.6, 0.4}};
  EXPECT_DOUBLE_EQ(field_at(projection, 0, 0), 1);
  EXPECT_DOUBLE_EQ(field_at(projection, 0.75, 0.25), 0.8);
  EXPECT_DOUBLE_EQ(field_at(projection, 0.5, 0.5), 0.7);
  EXPECT_DOUBLE_EQ(field_at(projection, 0.25, 1), 0.6);
}

TEST(MachineProfile, RefusesCurvesThatFallAndFieldsThatAreNoGrid) {
  const std::string good = to_toml(whole());
  for (const char* bad : {"curve = [0.0, 0.5, 0.4, 1.0]", "curve = [0.1, 1.0]", "curve = [0.0, 0.9]", "curve = [0.0]",
                          "curve = [0.0, nan, 1.0]", "curve = 2.2", "field = [[1.0, 1.0], [1.0]]", "field = [1.0, 0.9]",
                          "field = [[]]", "field = [[1.0, 0.01]]", "field = [[1.0, \"0.9\"]]"}) {
    std::string text = good;
    const std::string key{bad, std::string_view{bad}.find(' ')};
    const auto at = text.find("\n" + key + " =") + 1;
    text.replace(at, text.find('\n', at) - at, bad);
    const auto profile = machine_profile_from_toml(text, "x.toml");
    ASSERT_FALSE(profile) << bad;
    EXPECT_THAT(profile.error().what, HasSubstr("projection." + key)) << bad;
  }
}

TEST(MachineProfile, KnowsItsResinAsWellAsItsCalibrationSaysAndRefusesHalfAnInterval) {
  MachineProfile machine = whole();
  EXPECT_FALSE(machine.states_calibration_band());
  machine.resin.critical_dose_mj_per_cm2 = 10;
  machine.resin.critical_dose_least_mj_per_cm2 = 9;
  machine.resin.critical_dose_most_mj_per_cm2 = 11.5;
  EXPECT_FALSE(machine.states_calibration_band()) << "of Dp nothing is known";
  machine.resin.penetration_mm = 0.1;
  machine.resin.penetration_least_mm = 0.09;
  machine.resin.penetration_most_mm = 0.11;
  machine.resin.calibration_correlation = -0.9;
  EXPECT_TRUE(machine.states_calibration_band());
  EXPECT_EQ(machine_profile_from_toml(to_toml(machine), "text").value(), machine);
  for (const auto& [least, most] : {std::pair{0.0, 0.11}, {0.09, 0.0}, {0.101, 0.11}, {0.08, 0.099}}) {
    machine.resin.penetration_least_mm = least;
    machine.resin.penetration_most_mm = most;
    const auto read = machine_profile_from_toml(to_toml(machine), "x.toml");
    ASSERT_FALSE(read) << least << " to " << most;
    EXPECT_THAT(read.error().what, HasSubstr("resin.penetration_mm must lie in its own interval"));
    EXPECT_THAT(read.error().what, HasSubstr("line "));
  }
}

TEST(MachineProfile, KeepsTheDigestsOfATextThatKnowsNothingOfKeysThatCameLater) {
  const auto old = machine_profile_from_toml(R"(name = "old"
[platform]
width_mm = 96.0
depth_mm = 54.0
z_travel_mm = 120.0
[projection]
pixel_pitch_mm = 0.05
irradiance_mw_per_cm2 = 13.59
[layers]
thickness_mm = 0.05
exposure_s = 2.0
bottom_exposure_s = 16.0
[supports]
self_support_mm = 0.15
lift_off_mm = 2.0
)",
                                             "old.toml");
  ASSERT_TRUE(old) << old.error().what;
  // As found before there was shrinkage; the two supports stated were the defaults then.
  const std::string before = "8fca3ad47de3b18e1a9a73c0b003a83deaa1095bae8aab3c816f33309d98cf70";
  EXPECT_EQ(to_hex(digest_of_profile(*old)), before);
  EXPECT_EQ(to_hex(digest_of_light(*old)), before);
}

TEST(MachineProfile, ShrinkageComesBackFromItsTextAndIsPartOfTheDigests) {
  const MachineProfile plain = whole();
  EXPECT_THAT(to_toml(plain), Not(HasSubstr("shrink")));
  for (const auto value : {&MachineProfile::Resin::shrink_x_percent, &MachineProfile::Resin::shrink_y_percent,
                           &MachineProfile::Resin::shrink_z_percent, &MachineProfile::Resin::hole_growth_mm}) {
    MachineProfile machine = plain;
    machine.resin.*value = -0.25;
    EXPECT_EQ(machine_profile_from_toml(to_toml(machine), "text").value(), machine);
    EXPECT_NE(digest_of_profile(machine), digest_of_profile(plain));
    EXPECT_NE(digest_of_light(machine), digest_of_light(plain));
  }
}

/// One whose stage's board times the light behind a screen.
MachineProfile lit_by_its_stage() {
  MachineProfile machine = whole();
  machine.devices.projector = ProjectorKind::Screen;
  machine.devices.stage = StageKind::Grbl;
  machine.devices.light = LightSwitch::Stage;
  machine.screen = {"HDMI-A-1", "RHT 1234 0 QEMU Monitor", 540, 2560, 59.94, ScreenTurn::Quarter, PixelPacking::Bgr, 4};
  machine.light = {LightCommand::Pin, 9, 0.8, 200, 64};
  return machine;
}

TEST(MachineProfile, ScreenAndLightOfTheStageComeBackFromItsText) {
  const MachineProfile machine = lit_by_its_stage();
  const auto read = machine_profile_from_toml(to_toml(machine), "text");
  ASSERT_TRUE(read) << read.error().what;
  EXPECT_EQ(*read, machine);
}

TEST(MachineProfile, ThatSaysNothingOfAScreenHasTheTextItHad) {
  EXPECT_THAT(to_toml(whole()), Not(HasSubstr("[screen]")));
  EXPECT_THAT(to_toml(whole()), Not(HasSubstr("[light]")));
  EXPECT_THAT(to_toml(whole()), Not(HasSubstr("light =")));
}

TEST(MachineProfile, LightIsAnotherWhereItsPowerOrItsPackingIsButNotWhereItsConnectorIs) {
  const MachineProfile machine = lit_by_its_stage();
  MachineProfile other = machine;
  other.screen.connector = "HDMI-A-2";
  EXPECT_EQ(digest_of_light(other), digest_of_light(machine));
  EXPECT_EQ(digest_of_profile(other), digest_of_profile(machine));
  other.light.power = 0.7;
  EXPECT_NE(digest_of_light(other), digest_of_light(machine));
  other = machine;
  other.screen.packing = PixelPacking::Bits565;
  EXPECT_NE(digest_of_light(other), digest_of_light(machine));
}

TEST(MachineProfile, ExposuresInTransitionAreWholeStepsOfTheBoardThatTimesThem) {
  MachineProfile machine = lit_by_its_stage();
  machine.layers.exposure_s = 2;
  machine.layers.bottom_exposure_s = 9;
  machine.layers.bottom_count = 2;
  machine.layers.transition_count = 5;
  EXPECT_EQ(machine.exposure_step_s(), 0.05);
  for (std::uint32_t layer = 2; layer < 7; ++layer) {
    const double even = 9 - 7.0 * (layer - 1) / 6, steps = machine.exposure_of_layer_s(layer) / 0.05;
    EXPECT_NEAR(machine.exposure_of_layer_s(layer), even, 0.025 + 1e-9);
    EXPECT_NEAR(steps, std::round(steps), 1e-9);
  }
  machine.devices.light = LightSwitch::Projector;
  EXPECT_EQ(machine.exposure_step_s(), 0);
  EXPECT_NEAR(machine.exposure_of_layer_s(2), 9 - 7.0 / 6, 1e-12);
}

TEST(MachineProfile, NamesTheLineOfAnUnknownKey) {
  const auto profile = machine_profile_from_toml("name = \"x\"\n[layers]\nthickness_um = 3\n", "x.toml");
  ASSERT_FALSE(profile);
  EXPECT_THAT(profile.error().what, HasSubstr("x.toml, line 3"));
  EXPECT_THAT(profile.error().what, HasSubstr("layers.thickness_um"));
}

TEST(MachineProfile, RefusesValuesOutOfRangeNotFiniteOrOfTheWrongType) {
  const std::string good = to_toml(whole());
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

TEST(ProfileReference, OfTheDocumentsIsWhatTheVerbMakes) {
  std::ostringstream page;
  page << std::ifstream{std::string{std::getenv("TELEFAB_SOURCE")} + "/deploy/docs/profile-reference.md"}.rdbuf();
  EXPECT_EQ(page.str(), profile_reference())
      << "telefab-fab machines --keys --markdown > deploy/docs/profile-reference.md";
}

TEST(ProfileReference, HasEveryKeyWithUnitRangeDefaultAndMeaning) {
  const std::string page = profile_reference();
  EXPECT_THAT(page, HasSubstr("| `width_mm` | mm | 0.1 to 2000 | required | along x, the mask's columns |"));
  EXPECT_THAT(page, HasSubstr("| `irradiance_mw_per_cm2` | mW/cm² | 0.01 to 1000 | required |"));
  EXPECT_THAT(page, HasSubstr("| `vat_ml` | ml | 0 to 1000000 | `0"));
  EXPECT_THAT(page, HasSubstr("| `price_per_litre` | resin | a number above 0 |"));
  std::istringstream keys{describe_keys()};
  std::size_t count = 0;
  for (std::string line; std::getline(keys, line); ++count) {
    const std::string name =
        line.substr(line.find('.') + 1, line.find_first_of(": (", line.find('.')) - line.find('.') - 1);
    EXPECT_THAT(page, HasSubstr("| `" + name + "` |")) << line;
  }
  EXPECT_GT(count, 100U);
}

}  // namespace
}  // namespace telefab
