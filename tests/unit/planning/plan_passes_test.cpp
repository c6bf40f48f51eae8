// SPDX-License-Identifier: GPL-3.0-or-later
#include <gtest/gtest.h>

#include <telefab/fab/planning/plan_job.hpp>
#include <telefab/test/block_stack.hpp>

#include "plan_pass.hpp"

// What a pass keeps for the next must not show: each gives what it would give alone.
namespace telefab::fab {
namespace {

/// A plate on pins with a tower on it, high above them: several blocks of masks, of which the upper ones see no
/// support.
LayerStack tower() {
  std::vector<std::vector<Contour>> rings(20, {test::rectangle(8, 8, 28, 22)});
  rings.resize(110, {test::rectangle(14, 11, 22, 19)});
  return test::stack_of(rings);
}

struct Printed {
  std::vector<std::vector<std::byte>> masks;
  std::vector<std::vector<Contour>> supports;
  std::size_t times_begun = 0;
};

class PlanPassesTest : public testing::TestWithParam<MaskMethod> {
 protected:
  PlanPassesTest() { options_.supports.stand = SupportOptions::Stand::Never, options_.masks = GetParam(); }

  [[nodiscard]] PlanSink sink(Printed& printed) {
    return [&printed](const PlannedImage& layer) -> Result<void> {
      if (layer.index.count() == 0) {
        printed.masks.clear(), printed.supports.clear();
        ++printed.times_begun;
      }
      printed.masks.emplace_back(layer.png.begin(), layer.png.end());
      printed.supports.emplace_back(layer.supports.begin(), layer.supports.end());
      return {};
    };
  }
  /// A pass that nothing went before.
  [[nodiscard]] PlanSummary alone(const SupportOptions& supports, Printed& printed) {
    const PlanSink keep = sink(printed);
    return PlanPasses{stack_, machine_, options_, keep, clock_, progress_, {}}.plan(supports).value();
  }
  /// All that a report says but the time it took.
  [[nodiscard]] static std::string report(PlanSummary summary) {
    summary.support_seconds = summary.mask_seconds = summary.carry_seconds = 0;
    return to_json(summary) + summary.supports_json + to_json(summary.plan);
  }
  /// The supports of a pass, one of its pins being found too weak.
  [[nodiscard]] SupportOptions with_a_weak_pin(const PlanSummary& planned) const {
    SupportOptions supports = options_.supports;
    for (const Anchor& a : planned.anchors) supports.bearing.push_back({a.place, a.layer, a.tip, a.strength});
    supports.bearing.front().strength = 0.3;
    return supports;
  }

  LayerStack stack_ = tower();
  MachineProfile machine_ = test::small_machine();
  PlanOptions options_;
  VirtualClock clock_;
  ProgressSink progress_;
};

TEST_P(PlanPassesTest, MakesOfARepairWhatItIsAlone) {
  Printed first, repaired, as_alone;
  const PlanSink keep = sink(first);
  PlanPasses passes{stack_, machine_, options_, keep, clock_, progress_, {}};
  const auto planned = passes.plan(options_.supports);
  ASSERT_TRUE(planned);
  const auto masks_before = first.masks;
  passes.repair_last();
  const SupportOptions repair = with_a_weak_pin(*planned);
  const auto again = passes.plan(repair);
  ASSERT_TRUE(again);
  EXPECT_EQ(report(*again), report(alone(repair, as_alone)));
  EXPECT_EQ(first.masks, as_alone.masks);
  EXPECT_EQ(first.supports, as_alone.supports);
  EXPECT_NE(first.masks, masks_before) << "so that something was repaired";
  EXPECT_EQ(first.masks.back(), masks_before.back()) << "and something stayed";
}

TEST_P(PlanPassesTest, FallsBackToThePassThatWasRepaired) {
  Printed printed, as_alone;
  const PlanSink keep = sink(printed);
  PlanPasses passes{stack_, machine_, options_, keep, clock_, progress_, {}};
  const auto planned = passes.plan(options_.supports);
  ASSERT_TRUE(planned);
  passes.repair_last();
  ASSERT_TRUE(passes.plan(with_a_weak_pin(*planned)));
  const auto back = passes.plan(options_.supports);
  ASSERT_TRUE(back);
  EXPECT_EQ(report(*back), report(alone(options_.supports, as_alone)));
  EXPECT_EQ(printed.masks, as_alone.masks);
  EXPECT_EQ(printed.times_begun, 3U);
}

TEST_P(PlanPassesTest, MakesNoMaskTwiceWhereARepairChangesNothing) {
  Printed printed, as_alone;
  const PlanSink keep = sink(printed);
  PlanPasses passes{stack_, machine_, options_, keep, clock_, progress_, {}};
  const auto planned = passes.plan(options_.supports);
  ASSERT_TRUE(planned);
  passes.repair_last();
  // All stay as they are.
  SupportOptions same = with_a_weak_pin(*planned);
  same.bearing.front().strength = planned->anchors.front().strength;
  const auto again = passes.plan(same);
  ASSERT_TRUE(again);
  EXPECT_EQ(report(*again), report(alone(same, as_alone)));
  EXPECT_EQ(printed.masks, as_alone.masks);
  EXPECT_EQ(printed.times_begun, 1U);
}

INSTANTIATE_TEST_SUITE_P(Masks, PlanPassesTest,
                         testing::Values(MaskMethod::Cover, MaskMethod::Blend, MaskMethod::BlendStack));

}  // namespace
}  // namespace telefab::fab
