// SPDX-License-Identifier: GPL-3.0-or-later
#include <gtest/gtest.h>

#include <nlohmann/json.hpp>
#include <telefab/fab/planning/plan_job.hpp>
#include <telefab/test/block_stack.hpp>

namespace telefab::fab {
namespace {

/// A plate on pins whose lowest layer alone reaches out in lobes. Each layer is one region and held; but masks leave
/// the plate's underside dark, later layers cure it, and light the lobes at once: there nothing shines later.
LayerStack plate_with_lobes() {
  std::vector<std::vector<Contour>> rings(20, {test::rectangle(8, 8, 24, 20)});
  rings[0] = {
      Contour::from_vertices({{8, 8}, {24, 8}, {24, 12}, {25, 12}, {25, 13}, {24, 13}, {24, 20}, {8, 20}}).value()};
  return test::stack_of(rings);
}

PlanOptions lifted() {
  PlanOptions options;
  options.supports.stand = SupportOptions::Stand::Never;
  options.supports.mode = SupportOptions::Mode::Cover;  // what floats, whatever it bears
  return options;
}

struct Watched {
  PlanSummary summary;
  std::vector<std::uint32_t> layers;  ///< as the sink saw them
};

Watched plan(const LayerStack& stack, const PlanOptions& options) {
  const VirtualClock clock;
  Watched watched;
  const auto keep = [&](const PlannedImage& layer_image) -> Result<void> {
    watched.layers.push_back(layer_image.index.count());
    return {};
  };
  auto summary = plan_job(stack, test::small_machine(), options, keep, clock, {}, {});
  EXPECT_TRUE(summary) << summary.error().what;
  if (summary) watched.summary = std::move(*summary);
  return watched;
}

TEST(PlanAgain, GivesAnAnchorToWhatFloatsInTheMasksAlone) {
  const Watched planned = plan(plate_with_lobes(), lifted());
  EXPECT_EQ(planned.summary.repairs, 1U);
  EXPECT_EQ(planned.summary.figures.floating, 1U);
  EXPECT_TRUE(planned.summary.check.passes());
  const auto supports = nlohmann::json::parse(planned.summary.supports_json);
  bool is_under_the_lobe = false;
  for (const auto& anchor : supports["anchors"])
    is_under_the_lobe |= anchor["part_layer"] == 0 && anchor["x_mm"] > 24.0 && anchor["x_mm"] < 25.0;
  EXPECT_TRUE(is_under_the_lobe);
  EXPECT_EQ(supports["anchors"].size(), planned.summary.anchors.size());
}

TEST(PlanAgain, HandsOutAllLayersFromTheFirstOnAgain) {
  const Watched planned = plan(plate_with_lobes(), lifted());
  const std::size_t count = planned.summary.plan.layers.size();
  ASSERT_EQ(planned.layers.size(), 2 * count);
  for (std::uint32_t i = 0; i < planned.layers.size(); ++i) EXPECT_EQ(planned.layers[i], i % count);
}

TEST(PlanAgain, PlansOnceWhatDoesNotFloat) {
  const Watched planned = plan(test::table(30, 10), {});
  EXPECT_EQ(planned.summary.repairs, 0U);
  EXPECT_EQ(planned.layers.size(), planned.summary.plan.layers.size());
}

TEST(PlanAgain, ReportsWhatFloatsWherePlacesAreForbiddenByHand) {
  PlanOptions options = lifted();
  options.supports.hand.forbidden.push_back({{24.5, 12.5}, 2, 0, 10});
  const Watched planned = plan(plate_with_lobes(), options);
  EXPECT_EQ(planned.summary.figures.floating, 0U);
  EXPECT_EQ(planned.summary.check.count(Finding::Kind::Island), 1U);
  EXPECT_LE(planned.summary.repairs, 1U);
}

TEST(PlanAgain, PutsNoSupportWhereNoneAreWanted) {
  PlanOptions options;
  options.supports.mode = SupportOptions::Mode::None;
  std::vector<std::vector<Contour>> rings(10, {test::rectangle(5, 5, 15, 15)});
  for (std::size_t i = 5; i < 10; ++i) rings[i].push_back(test::rectangle(20, 20, 22, 22));
  const Watched planned = plan(test::stack_of(rings), options);
  EXPECT_EQ(planned.summary.repairs, 0U);
  EXPECT_EQ(planned.summary.anchors.size(), 0U);
  EXPECT_EQ(planned.summary.check.count(Finding::Kind::Island), 1U);
}

TEST(PlanAgain, GivesTheSamePlanOnAnyNumberOfThreads) {
  PlanOptions one = lifted(), many = lifted();
  one.threads = 1;
  many.threads = 4;
  const Watched a = plan(plate_with_lobes(), one), b = plan(plate_with_lobes(), many);
  EXPECT_EQ(a.summary.supports_json, b.summary.supports_json);
  EXPECT_EQ(plan_digest(a.summary.plan), plan_digest(b.summary.plan));
}

}  // namespace
}  // namespace telefab::fab
