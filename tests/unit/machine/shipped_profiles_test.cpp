// SPDX-License-Identifier: GPL-3.0-or-later
#include <gmock/gmock.h>

#include <cmath>
#include <set>
#include <telefab/machine/profile_catalogue.hpp>

// The catalogue that comes with the programs: what makers and slicers publish, and what is only assumed.
namespace telefab {
namespace {

const ProfileCatalogue& shipped() {
  static const auto catalogue = builtin_profiles();
  return catalogue.value();
}

std::vector<const ProfilePart*> with_source(ProfileKind kind) {
  std::vector<const ProfilePart*> found;
  for (const ProfilePart* part : shipped().offered(kind))
    if (!part->source.empty()) found.push_back(part);
  return found;
}

/// The machines of the paper and the light engine on a bench are no products; their figures are the paper's.
bool is_product(const ProfilePart& machine) {
  static const std::set<std::string_view> kBench{"dlp6500", "machine-a", "machine-b", "machine-c"};
  return !kBench.contains(machine.name);
}

TEST(ShippedProfiles, AreTwentyPrintersAndEightResinsOrMore) {
  EXPECT_GE(with_source(ProfileKind::Machine).size(), 20U);
  EXPECT_GE(with_source(ProfileKind::Resin).size(), 8U);
  EXPECT_GE(shipped().offered(ProfileKind::Print).size(), 3U);
}

TEST(ShippedProfiles, StateTheSourceOfEveryPrinterAndResin) {
  for (const ProfilePart* machine : shipped().offered(ProfileKind::Machine))
    if (is_product(*machine)) {
      EXPECT_FALSE(machine->source.empty()) << machine->name;
    }
  for (const ProfilePart* resin : shipped().offered(ProfileKind::Resin))
    EXPECT_FALSE(resin->source.empty()) << resin->name;
}

TEST(ShippedProfiles, PitchTimesPixelsIsTheSizeOfThePlatformToAPixel) {
  for (const ProfilePart* part : shipped().offered(ProfileKind::Machine)) {
    if (!is_product(*part)) continue;
    const MachineProfile p = shipped().compose({part->name})->profile;
    const double pitch_mm = p.projection.pixel_pitch_mm;
    ASSERT_GT(p.projection.width_px, 0U) << part->name;
    EXPECT_EQ(p.mask_size(), (PixelSize{p.projection.width_px, p.projection.height_px})) << part->name;
    EXPECT_NEAR(pitch_mm * p.projection.width_px, p.platform.width_mm, pitch_mm) << part->name;
    EXPECT_NEAR(pitch_mm * p.projection.height_px, p.platform.depth_mm, pitch_mm) << part->name;
  }
}

// A figure without a source that is not on the list would pass for a published one.
TEST(ShippedProfiles, EveryFigureHasASourceOrIsListedAsAssumed) {
  for (const ProfilePart& part : shipped().parts()) {
    if (part.kind == ProfileKind::Machine && !is_product(part)) continue;
    for (const auto& [key, line] : part.lines) {
      const bool is_assumed = std::ranges::find(part.assumed, key) != part.assumed.end();
      EXPECT_TRUE(is_assumed || !part.source.empty()) << part.file << ", line " << line << ": " << key;
    }
  }
}

TEST(ShippedProfiles, NoPrintersIrradianceIsTakenForPublished) {
  for (const ProfilePart* part : shipped().offered(ProfileKind::Machine))
    if (is_product(*part)) {
      EXPECT_TRUE(shipped().compose({part->name})->profile.is_assumed("projection.irradiance_mw_per_cm2"))
          << part->name;
    }
}

TEST(ShippedProfiles, EveryMachinePrintsEveryResinInEveryWay) {
  for (const ProfilePart* machine : shipped().offered(ProfileKind::Machine))
    for (const ProfilePart* resin : shipped().offered(ProfileKind::Resin))
      for (const ProfilePart* print : shipped().offered(ProfileKind::Print)) {
        const auto made = shipped().compose({machine->name, resin->name, print->name});
        ASSERT_TRUE(made) << machine->name << ' ' << resin->name << ' ' << print->name << ": " << made.error().what;
        EXPECT_GT(made->profile.layers.bottom_exposure_s, made->profile.layers.exposure_s) << machine->name;
      }
}

TEST(ShippedProfiles, ExposuresThatArePublishedAreOfPrintersThatThereAre) {
  for (const ProfilePart* resin : shipped().offered(ProfileKind::Resin))
    for (const PublishedExposure& each : resin->exposures)
      EXPECT_TRUE(shipped().compose({each.machine, resin->name})) << resin->name << ' ' << each.machine;
}

TEST(ShippedProfiles, DriveVirtualDevicesOnly) {
  for (const MachineProfile& machine : shipped().machines()) {
    EXPECT_EQ(machine.devices.projector, ProjectorKind::Virtual) << machine.name;
    EXPECT_EQ(machine.devices.stage, StageKind::Virtual) << machine.name;
  }
}

}  // namespace
}  // namespace telefab
