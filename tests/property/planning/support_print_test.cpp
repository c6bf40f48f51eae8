// SPDX-License-Identifier: GPL-3.0-or-later
#include <fmt/format.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <telefab/base/clock.hpp>
#include <telefab/fab/cure/support_calibration.hpp>
#include <telefab/fab/planning/plan_job.hpp>
#include <telefab/test/profiles.hpp>

namespace telefab::fab {
namespace {

using Kind = SupportSpecimen::Kind;

bool is_in(const Bounds2& box, Point2 p) {
  return p.x_mm >= box.min.x_mm && p.x_mm <= box.max.x_mm && p.y_mm >= box.min.y_mm && p.y_mm <= box.max.y_mm;
}

class SupportPrintOf : public testing::TestWithParam<const char*> {};

// The masks as they would be shown, and the judge who knows nothing of how they came about.
TEST_P(SupportPrintOf, AsksOfEachDiscWhatTheJudgeOfMasksFinds) {
  MachineProfile machine = test::known_machine(GetParam());
  const auto print = support_print(machine);
  ASSERT_TRUE(print) << print.error().what;
  // What bears more than 20 times the pull is listed.
  machine.resin.green_strength_mpa =
      20 * machine.supports.safety * machine.pull_of_film_kpa() / 1000 / machine.supports.fresh_share;
  PlanOptions options;
  options.supports.mode = SupportOptions::Mode::None;
  options.masks = MaskMethod::Cover;  // as the README of the print asks
  const VirtualClock clock;
  const auto plan =
      plan_job(print->stack, machine, options, [](const PlannedImage&) -> Result<void> { return {}; }, clock, {}, {});
  ASSERT_TRUE(plan) << plan.error().what;
  EXPECT_TRUE(plan->check.passes()) << "nothing floats";
  EXPECT_EQ(plan->carry.afloat_mm2, 0);
  EXPECT_EQ(plan->elevation_layers, 0U);
  std::vector<CarryPlace> places = plan->carry.weak;
  places.insert(places.end(), plan->carry.weak_small.begin(), plan->carry.weak_small.end());
  double worst_ladder = 0, worst_moved = 0;
  std::size_t discs = 0;
  for (const SupportSpecimen& s : print->specimens) {
    double found = 0;
    std::uint32_t moment = 0;
    for (const CarryPlace& place : places)
      if (is_in(s.box, place.place) && place.demand > found) found = place.demand, moment = place.moment.count();
    if (s.kind == Kind::Shelf) {
      EXPECT_LT(found, 30) << "the wall of a shelf is none of the ladder: " << s.number;
      continue;
    }
    ++discs;
    double& worst = s.kind == Kind::Ladder ? worst_ladder : worst_moved;
    worst = std::max(worst, std::abs(found / s.demand - 1));
    EXPECT_NEAR(found / s.demand, 1, s.kind == Kind::Ladder ? 0.1 : 0.2)
        << name_of(s.kind) << ' ' << s.number << ": " << s.demand << ", judged " << found << " at layer " << moment;
    EXPECT_GE(moment, plan->plan.layers.size() - 20) << "at the end: " << s.number;
  }
  fmt::print(
      "{}: {} discs of {:.2f} mm, {} layers, block {:.0f} mm2; judged {:.1f} % off the ladder, {:.1f} % off centre\n",
      machine.name, discs, print->disc_mm, plan->plan.layers.size(), print->block_mm2, 100 * worst_ladder,
      100 * worst_moved);
}

// machine-c's pixels are wider than its layers are thick; the last two are of the catalogue.
INSTANTIATE_TEST_SUITE_P(Machines, SupportPrintOf,
                         testing::Values("machine-a", "machine-b", "machine-c", "elegoo-mars-3",
                                         "anycubic-photon-ultra"),
                         [](const auto& at) {
                           std::string name = at.param;
                           std::replace(name.begin(), name.end(), '-', '_');
                           return name;
                         });

}  // namespace
}  // namespace telefab::fab
