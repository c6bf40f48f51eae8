// SPDX-License-Identifier: GPL-3.0-or-later
#include <gtest/gtest.h>

#include <telefab/fab/planning/plan_job.hpp>
#include <telefab/test/block_stack.hpp>

#include "plan_repair.hpp"

// Plans whose final masks were judged by the pull they must bear, and planned again until they do.
namespace telefab::fab {
namespace {

PlanSummary planned(const LayerStack& stack, SupportOptions::Mode mode, const MachineProfile& machine) {
  const VirtualClock clock;
  PlanOptions options;
  options.supports.stand = SupportOptions::Stand::Never;
  options.supports.mode = mode;
  auto summary =
      plan_job(stack, machine, options, [](const PlannedImage&) -> Result<void> { return {}; }, clock, {}, {});
  EXPECT_TRUE(summary) << summary.error().what;
  return summary ? std::move(*summary) : PlanSummary{};
}

/// A roof that rises to one side, so that pins of many heights hold it.
LayerStack roof() {
  std::vector<std::vector<Contour>> rings;
  for (int k = 0; k < 80; ++k) rings.push_back({test::rectangle(6, 6, std::min(34.0, 10 + 0.4 * k), 24)});
  return test::stack_of(rings);
}

TEST(PlanCarries, LeavesNoPinUnderALiftedBlockOrARoofAboveWhatItMayBear) {
  const MachineProfile machine = test::small_machine();
  for (const auto& stack : {test::stack_of(std::vector(20, std::vector{test::rectangle(8, 8, 28, 22)})), roof()}) {
    const PlanSummary plan = planned(stack, SupportOptions::Mode::Auto, machine);
    ASSERT_NE(plan.carry.worst(), nullptr);
    EXPECT_LE(plan.carry.worst()->demand, machine.carried_demand());
    EXPECT_TRUE(plan.check.passes());
    EXPECT_GT(plan.figures.medium_tips + plan.figures.heavy_tips, 0U);
  }
}

TEST(PlanCarries, LeavesWhatCoveringGivesWhereItIsAskedFor) {
  const MachineProfile machine = test::small_machine();
  const PlanSummary plan = planned(roof(), SupportOptions::Mode::Cover, machine);
  EXPECT_EQ(plan.repairs, 0U);
  EXPECT_EQ(plan.figures.medium_tips + plan.figures.heavy_tips, 0U);
  ASSERT_NE(plan.carry.worst(), nullptr);
  EXPECT_GT(plan.carry.worst()->demand, machine.carried_demand()) << "so that the other case shows something";
}

/// Two pins, of which the section of one bears `demand`.
PlanSummary with_weak_place(Point2 place, std::uint32_t layer, double demand) {
  PlanSummary plan;
  plan.elevation_layers = 20;
  plan.anchors = {{{10, 10}, LayerIndex{0}, false, false, TipClass::Heavy, 1, {10, 10}},
                  {{20, 10}, LayerIndex{5}, false, false, TipClass::Medium, 0.8, {23, 10}}};
  CarryPlace weak;
  weak.check = CarryPlace::Check::Lever;
  weak.place = place;
  weak.layer = LayerIndex{layer};
  weak.demand = demand;
  weak.held_mm2 = 100;
  plan.carry.lever = weak;
  plan.carry.weak = {weak};
  return plan;
}

TEST(PlanRepair, LetsAWeakPinCountForLessAndKeepsTheOthersAsTheyAre) {
  const MachineProfile machine = test::small_machine();
  const double limit = machine.carried_demand();
  // On the arm, between contact and foot.
  const PlanSummary plan = with_weak_place({21.5, 10.1}, 18, 2 * limit);
  EXPECT_NEAR(faults_of(plan, machine).overload, 1, 1e-12);
  SupportOptions supports;
  ASSERT_TRUE(relieve_pins(plan, machine, supports));
  ASSERT_EQ(supports.bearing.size(), 2U);
  EXPECT_EQ(supports.bearing[0].strength, 1);
  EXPECT_EQ(supports.bearing[0].tip, TipClass::Heavy);
  EXPECT_LT(supports.bearing[1].strength, 0.8 / 2);
  EXPECT_GT(supports.bearing[1].strength, 0.8 / 3);
}

TEST(PlanRepair, FindsNoPinToHelpInThePartItself) {
  const MachineProfile machine = test::small_machine();
  SupportOptions supports;
  EXPECT_FALSE(relieve_pins(with_weak_place({15, 20}, 18, 900), machine, supports)) << "nobody stands there";
  EXPECT_FALSE(relieve_pins(with_weak_place({10, 10}, 60, 900), machine, supports)) << "far above the contact";
}

TEST(PlanCarries, EndsWhereSupportsCannotHelp) {
  // A ball on a neck that is too thin for it: no pin reaches the ball from below without passing the plate.
  std::vector<std::vector<Contour>> rings(10, {test::rectangle(4, 4, 36, 26)});
  rings.resize(14, {test::rectangle(19.7, 14.7, 20.3, 15.3)});
  rings.resize(60, {test::rectangle(14, 9, 26, 21)});
  const MachineProfile machine = test::small_machine();
  const PlanSummary plan = planned(test::stack_of(rings), SupportOptions::Mode::Auto, machine);
  EXPECT_LE(plan.repairs, 4U);
  ASSERT_NE(plan.carry.worst(), nullptr);
}

}  // namespace
}  // namespace telefab::fab
