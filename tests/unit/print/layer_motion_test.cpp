// SPDX-License-Identifier: GPL-3.0-or-later
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <telefab/fab/print/layer_motion.hpp>
#include <telefab/fab/print/print_plan.hpp>
#include <telefab/test/layer_motions.hpp>

namespace telefab::fab {
namespace {

using namespace std::chrono_literals;
using testing::HasSubstr;

double seconds(Nanoseconds time) { return std::chrono::duration<double>(time).count(); }

TEST(StagePath, TakesWaysOverSpeedsWhereSpeedsAreReachedAtOnce) {
  const StageLeg legs[] = {{2, 1}, {6, 4}};
  EXPECT_DOUBLE_EQ(seconds(path_time(0, legs, 0)), 3);
}

TEST(StagePath, SpeedsUpAndBrakesOverEveryRest) {
  const StageLeg long_way{10, 2}, short_way{0.1, 2};
  EXPECT_NEAR(seconds(path_time(0, {&long_way, 1}, 10)), 10 / 2.0 + 2 / 10.0, 1e-9);
  EXPECT_NEAR(seconds(path_time(0, {&short_way, 1}, 10)), 2 * std::sqrt(0.1 / 10), 1e-9);
}

TEST(StagePath, PassesFromASlowLegToAFastOneWithoutRest) {
  const StageLeg legs[] = {{2, 1}, {10, 4}};
  const double a = 10;
  const auto times = leg_times(0, legs, a);
  EXPECT_NEAR(seconds(times[0]), 2 / 1.0 + 1 / (2 * a), 1e-9) << "it need not brake";
  // From 1 to 4 mm/s and to rest.
  const double ramps_mm = (4 * 4 - 1 * 1 + 4 * 4) / (2 * a);
  EXPECT_NEAR(seconds(times[1]), (4 - 1 + 4) / a + (8 - ramps_mm) / 4, 1e-9);
  const StageLeg back[] = {{2, 1}, {1, 4}};
  EXPECT_NEAR(seconds(leg_times(0, back, a)[0]), 2 / 1.0 + 1 / a, 1e-9) << "a turn is a rest";
}

MachineProfile::Motion stated() {
  MachineProfile::Motion motion;
  motion.large_area_mm2 = 100;
  motion.large.lift_mm = 9;
  motion.large.lift_speed_mm_per_s = 1;
  motion.large.tilt_s = 8;
  motion.bottom.lift_mm = 7;
  motion.bottom.wait_after_exposure_s = 2;
  return motion;
}

TEST(LayerMotion, IsThatOfEveryLayerUnlessALargeOrABottomOneStatesItsOwn) {
  const MachineProfile::Motion motion = stated();
  EXPECT_EQ(motion_of(motion, false, 100), LayerMotion{}) << "not above the area";
  const LayerMotion large = motion_of(motion, false, 100.1);
  EXPECT_EQ(large.lift_mm, 9);
  EXPECT_EQ(large.tilt_s, 8);
  EXPECT_EQ(large.wait_after_exposure_s, 0);
  const LayerMotion bottom = motion_of(motion, true, 500);
  EXPECT_EQ(bottom.lift_mm, 7) << "bottom goes before large";
  EXPECT_EQ(bottom.lift_speed_mm_per_s, 1) << "large where bottom says nothing";
  EXPECT_EQ(bottom.wait_after_exposure_s, 2);
  EXPECT_EQ(bottom.settle_s, 0.5);
}

TEST(LayerMotion, OfAProfileThatStatesNothingNewIsOneLiftTwoSpeedsAndARest) {
  const MachineProfile::Motion motion{6, 2.5, 3.5, 0.7};
  for (const bool is_bottom : {false, true}) {
    LayerMotion plain;
    plain.lift_mm = 6, plain.lift_speed_mm_per_s = 2.5, plain.lower_speed_mm_per_s = 3.5, plain.settle_s = 0.7;
    EXPECT_EQ(motion_of(motion, is_bottom, 1e6), plain);
  }
}

TEST(LayerMotion, ApproachesSlowlyFromWhereverItIs) {
  LayerMotion motion;
  motion.approach_mm = 2, motion.approach_speed_mm_per_s = 0.5;
  EXPECT_EQ(lowering_path(motion, 1, 9), (std::vector<StageLeg>{{3, 3}, {1, 0.5}}));
  EXPECT_EQ(lowering_path(motion, 1, 2.5), (std::vector<StageLeg>{{1, 0.5}})) << "it is within the approach already";
  EXPECT_EQ(lowering_path(motion, 1, 0.9), (std::vector<StageLeg>{{1, 0.5}})) << "up by a layer behind a tilt";
}

TEST(LayerMotion, SaysWhatIsWrongWithIt) {
  const auto wrong = [](auto change) {
    LayerMotion motion = test::every_step_and_tilt();
    change(motion);
    const auto ok = motion.validate();
    return ok ? std::string{} : ok.error().what;
  };
  EXPECT_EQ(wrong([](LayerMotion&) {}), "");
  EXPECT_EQ(wrong([](LayerMotion& m) { m.lift_mm = m.peel_mm = 0; }), "") << "the vat tips";
  EXPECT_THAT(wrong([](LayerMotion& m) { m.lift_mm = m.peel_mm = m.tilt_s = 0; }), HasSubstr("film never comes off"));
  EXPECT_THAT(wrong([](LayerMotion& m) { m.peel_mm = 6; }), HasSubstr("peel of 6 mm is longer"));
  EXPECT_THAT(wrong([](LayerMotion& m) { m.peel_speed_mm_per_s = 0; }), HasSubstr("speed of its peel"));
  EXPECT_THAT(wrong([](LayerMotion& m) { m.approach_speed_mm_per_s = 0; }), HasSubstr("speed of its approach"));
  EXPECT_THAT(wrong([](LayerMotion& m) { m.lift_speed_mm_per_s = 0; }), HasSubstr("speeds of its lift"));
  for (const double bad :
       {-1.0, 1e9, std::numeric_limits<double>::quiet_NaN(), std::numeric_limits<double>::infinity()})
    for (double LayerMotion::*value : {&LayerMotion::approach_mm, &LayerMotion::settle_s, &LayerMotion::tilt_s,
                                       &LayerMotion::wait_after_exposure_s, &LayerMotion::wait_after_lift_s})
      EXPECT_NE(wrong([&](LayerMotion& m) { m.*value = bad; }), "") << bad;
}

PrintPlan small_plan() {
  PrintPlan plan;
  plan.job = "j";
  plan.machine = "m";
  plan.mask_size = {4, 3};
  plan.z_travel_mm = 10;
  for (std::uint32_t i = 0; i < 3; ++i) plan.layers.push_back({LayerIndex{i}, 0.5 * (i + 1), 2s, {}});
  return plan;
}

TEST(PrintPlan, OfOneMotionForAllLayersHasTheBytesThatItEverHad) {
  const std::string zeros(64, '0');
  std::string text = R"({
 "format": "telefab-print-plan-1",
 "job": "j",
 "machine": "m",
 "mask_width_px": 4,
 "mask_height_px": 3,
 "z_travel_mm": 10.0,
 "lift_mm": 5.0,
 "lift_speed_mm_per_s": 2.0,
 "lower_speed_mm_per_s": 3.0,
 "settle_s": 0.5,
 "layers": [
)";
  for (int i = 0; i < 3; ++i)
    text += "  {\n   \"layer\": " + std::to_string(i) + ",\n   \"z_mm\": " +
            (i == 0   ? "0.5"
             : i == 1 ? "1.0"
                      : "1.5") +
            ",\n   \"exposure_us\": 2000000,\n   \"mask_sha256\": \"" + zeros + "\"\n  }" + (i < 2 ? ",\n" : "\n");
  text += " ]\n}\n";
  EXPECT_EQ(to_json(small_plan()), text);
  const auto back = print_plan_from_json(text);
  ASSERT_TRUE(back) << back.error().what;
  EXPECT_EQ(*back, small_plan());
}

TEST(PrintPlan, KeepsMotionAndLightOfEveryLayer) {
  const auto comes_back = [](auto change) {
    PrintPlan plan = small_plan();
    change(plan);
    const std::string text = to_json(plan);
    EXPECT_THAT(text, HasSubstr("telefab-print-plan-2"));
    const auto back = print_plan_from_json(text);
    ASSERT_TRUE(back) << back.error().what;
    EXPECT_EQ(*back, plan);
    EXPECT_NE(plan_digest(plan), plan_digest(small_plan()));
  };
  comes_back([](PrintPlan& p) { p.layers[1].motion = test::every_step_and_tilt(); });
  comes_back([](PrintPlan& p) { p.layers[2].motion = test::tilt_alone(); });
  comes_back([](PrintPlan& p) { p.layers[0].motion.lift_mm = 8; });
  comes_back([](PrintPlan& p) { p.layers[2].light_share = 0.3; });
  comes_back([](PrintPlan& p) { p.acceleration_mm_per_s2 = 30; });
}

TEST(PrintPlan, RefusesAFormatOfALaterVersionByName) {
  std::string text = to_json(small_plan());
  text.replace(text.find("plan-1"), 6, "plan-9");
  const auto refused = print_plan_from_json(text);
  ASSERT_FALSE(refused);
  EXPECT_THAT(refused.error().what, HasSubstr("telefab-print-plan-9"));
}

TEST(PrintPlan, RefusesALayerWithAMotionThatIsNotThere) {
  PrintPlan plan = small_plan();
  plan.layers[1].motion = test::every_step();
  std::string text = to_json(plan);
  const auto at = text.find("\"motion\": 1");
  ASSERT_NE(at, std::string::npos);
  text.replace(at, 11, "\"motion\": 2");
  const auto refused = print_plan_from_json(text);
  ASSERT_FALSE(refused);
  EXPECT_THAT(refused.error().what, HasSubstr("motion 2 of 2"));
}

TEST(PrintPlan, GivesTheExposureAtFullLightThatHasTheSameDose) {
  PlannedLayer layer;
  layer.exposure = 3s;
  EXPECT_EQ(layer.exposure_at_full_light(), 3s);
  layer.light_share = 0.25;
  EXPECT_EQ(layer.exposure_at_full_light(), 750ms);
}

}  // namespace
}  // namespace telefab::fab
