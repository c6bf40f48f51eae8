// SPDX-License-Identifier: GPL-3.0-or-later
#include <gtest/gtest.h>

#include <cmath>
#include <telefab/machine/machine_profile.hpp>

namespace telefab {
namespace {

/// Exposes so that one layer of 0.15 mm cures two layers deep, one penetration.
MachineProfile exposed() {
  MachineProfile m;
  m.layers = {0.15, 10.0, 4, 40.0};
  m.resin.penetration_mm = 0.3;
  m.resin.critical_dose_mj_per_cm2 = 10;
  m.projection.irradiance_mw_per_cm2 = std::exp(1.0);
  return m;
}

TEST(Overhang, ReachesAsFarAsBendingAllowsWhateverItIsAttachedTo) {
  const MachineProfile m = exposed();
  // A strip twice as deep as the layer, 0.136 of a full section of that depth, as integrated by hand.
  EXPECT_NEAR(m.overhang_share(), 4 * 0.136, 0.01);
  EXPECT_NEAR(m.carried_demand(), 125, 1e-9);
  EXPECT_NEAR(m.self_support_reach_mm(1), 0.15 * std::sqrt(0.544 * 125 / 3), 0.01);
  EXPECT_EQ(m.self_support_reach_mm(1), m.self_support_reach_mm(10'000));
}

TEST(Overhang, ReachesFartherWhereThePullIsGentle) {
  MachineProfile gentle = exposed(), hard = exposed();
  gentle.motion.pull_kpa = 10;
  hard.motion.pull_kpa = 40;
  EXPECT_NEAR(gentle.self_support_reach_mm(1) / hard.self_support_reach_mm(1), 2, 1e-9);
}

TEST(Overhang, ReachesFartherTheDeeperItIsCured) {
  MachineProfile deeper = exposed();
  deeper.layers.exposure_s *= 2;
  EXPECT_GT(deeper.self_support_reach_mm(1), 1.2 * exposed().self_support_reach_mm(1));
  MachineProfile uncured = exposed();
  uncured.layers.exposure_s = 0.1;
  EXPECT_LT(uncured.self_support_reach_mm(1), 0.4 * exposed().self_support_reach_mm(1));
  EXPECT_GT(uncured.self_support_reach_mm(1), 0);
}

TEST(Overhang, TakesTheShareThatACalibrationFound) {
  MachineProfile measured = exposed();
  measured.supports.overhang_share = 4 * exposed().overhang_share();
  EXPECT_NEAR(measured.self_support_reach_mm(1), 2 * exposed().self_support_reach_mm(1), 1e-9);
}

TEST(Overhang, KeepsToAStatedLengthThatGrowsWithWhatItIsAttachedTo) {
  MachineProfile stated = exposed();
  stated.supports.self_support_mm = 0.2;
  stated.supports.self_support_growth_per_mm = 0.5;
  stated.supports.self_support_most_mm = 1;
  EXPECT_NEAR(stated.self_support_reach_mm(4), 0.4, 1e-12);
  EXPECT_NEAR(stated.self_support_reach_mm(1e6), 1, 1e-12);
}

TEST(PullOfFilm, GrowsWithTheSpeedWithWhichTheLayerComesOff) {
  MachineProfile m;
  m.motion.lift_speed_mm_per_s = 4;
  EXPECT_DOUBLE_EQ(m.pull_share_of_layer(9, 1), 1) << "no speed is stated";
  m.motion.pull_speed_mm_per_s = 1;
  m.motion.pull_speed_power = 0.5;
  EXPECT_DOUBLE_EQ(m.pull_share_of_layer(9, 1), 2);
  m.motion.peel_mm = 2;
  m.motion.peel_speed_mm_per_s = 0.25;
  EXPECT_DOUBLE_EQ(m.pull_share_of_layer(9, 1), 0.5) << "it comes off in the slow part";
  m.motion.large_area_mm2 = 100;
  m.motion.large.peel_speed_mm_per_s = 0.0625;
  EXPECT_DOUBLE_EQ(m.pull_share_of_layer(9, 101), 0.25);
  EXPECT_DOUBLE_EQ(m.pull_share_of_layer(9, 100), 0.5);
  m.motion.tilt_s = 3;
  EXPECT_DOUBLE_EQ(m.pull_share_of_layer(9, 101), 1) << "the vat tips, whatever the lift does";
}

TEST(PullOfFilm, OfAHollowIsNoMoreThanTheAirCanPressUnlessStated) {
  MachineProfile m;
  EXPECT_DOUBLE_EQ(m.vacuum_of_hollow_kpa(), 50);
  m.motion.pull_kpa = 60;
  EXPECT_DOUBLE_EQ(m.vacuum_of_hollow_kpa(), 101);
  m.motion.vacuum_kpa = 8;
  EXPECT_DOUBLE_EQ(m.vacuum_of_hollow_kpa(), 8);
}

TEST(PullOfFilm, IsManyTimesALayersWeight) {
  MachineProfile m;
  m.layers.thickness_mm = 0.1;
  m.resin.density_g_per_ml = 1 / 1.07;
  EXPECT_NEAR(m.weight_share(), 0.981 / 20'000, 1e-12);
}

}  // namespace
}  // namespace telefab
