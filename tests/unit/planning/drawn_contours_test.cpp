// SPDX-License-Identifier: GPL-3.0-or-later
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <numeric>
#include <telefab/fab/planning/drawn_contours.hpp>
#include <telefab/fab/planning/plan_job.hpp>
#include <telefab/fab/region/region.hpp>
#include <telefab/image/png.hpp>
#include <telefab/test/block_stack.hpp>

namespace telefab::fab {
namespace {

std::vector<Contour> hollow(double wall_mm, bool has_island = false) {
  auto outer = test::rectangle(5, 5, 25, 25);
  const auto turned = [](const Contour& c) {
    std::vector<Point2> places(c.vertices().begin(), c.vertices().end());
    std::reverse(places.begin(), places.end());
    return Contour::from_vertices(std::move(places)).value();
  };
  std::vector<Contour> rings{outer, turned(test::rectangle(5 + wall_mm, 10, 15, 20))};
  if (has_island) rings.push_back(test::rectangle(9, 13, 11, 17));
  return rings;
}

Region grown(const std::vector<Contour>& rings, double growth_mm) {
  const auto stack = with_grown_holes(test::stack_of({rings}), Millimetres{growth_mm});
  EXPECT_TRUE(stack) << stack.error().what;
  return Region::from_contours(stack->layers()[0].contours).value();
}

TEST(DrawnContours, GrowHolesAndNothingElse) {
  const Region before = Region::from_contours(hollow(3)).value(), after = grown(hollow(3), 0.2);
  EXPECT_EQ(after.bounds(), before.bounds());
  for (const Point2 beside : {Point2{7.9, 15}, Point2{15.1, 15}, Point2{11, 9.9}, Point2{11, 20.1}}) {
    EXPECT_TRUE(before.contains(beside));
    EXPECT_FALSE(after.contains(beside));
  }
  for (const Point2 beyond : {Point2{7.7, 15}, Point2{15.3, 15}, Point2{5.1, 5.1}, Point2{24.9, 24.9}})
    EXPECT_TRUE(after.contains(beyond));
  // A hole of 7 by 10 mm grows by its length times the growth, and a round corner's worth.
  EXPECT_NEAR(before.area_mm2() - after.area_mm2(), 2 * (7 + 10) * 0.2 + 3.14159 * 0.04, 0.002);
}

TEST(DrawnContours, ShrinkHolesThatWouldComeOutTooLarge) {
  const Region after = grown(hollow(3), -0.2);
  EXPECT_TRUE(after.contains({8.1, 15}));
  EXPECT_FALSE(after.contains({8.3, 15}));
}

TEST(DrawnContours, LeaveThinWallsAndWhatLiesInAHole) {
  for (const double wall_mm : {0.1, 0.3, 0.5}) {
    const Region after = grown(hollow(wall_mm), 0.2);
    EXPECT_EQ(after.pieces().size(), 1u);
    const double kept_mm = wall_mm < 0.2 ? wall_mm : std::max(0.2, wall_mm - 0.2);
    EXPECT_TRUE(after.contains({5 + kept_mm - 0.01, 15})) << wall_mm;
    EXPECT_FALSE(after.contains({5 + kept_mm + 0.01, 15})) << wall_mm;
  }
  const Region island = grown(hollow(3, true), 0.2);
  EXPECT_TRUE(island.contains({9.01, 13.01}));
  EXPECT_FALSE(island.contains({8.99, 15}));
}

TEST(DrawnContours, AreTheSameStackWithoutGrowthAndTheSameBytesTwice) {
  const LayerStack stack = test::stack_of({hollow(3), hollow(2), {test::rectangle(5, 5, 9, 9)}});
  EXPECT_EQ(*with_grown_holes(stack, Millimetres{0}), stack);
  const auto once = with_grown_holes(stack, Millimetres{0.1}), twice = with_grown_holes(stack, Millimetres{0.1});
  EXPECT_EQ(digest_of(*once), digest_of(*twice));
  EXPECT_EQ(once->layers()[2], stack.layers()[2]) << "a layer without holes stays as it is";
  EXPECT_EQ(with_grown_holes(stack, Millimetres{std::numeric_limits<double>::infinity()}).error().code,
            ErrorCode::InvalidInput);
}

TEST(DrawnContours, AreWhatMasksAreMadeOf) {
  const LayerStack stack = test::stack_of({hollow(3), hollow(3)});
  const auto lit_mm2 = [&](double growth_mm) {
    MachineProfile machine = test::small_machine();
    machine.resin.hole_growth_mm = growth_mm;
    PlanOptions options;
    options.masks = MaskMethod::Cover;
    options.supports.mode = SupportOptions::Mode::None;
    double area = 0;
    const auto sink = [&](const PlannedImage& image) -> Result<void> {
      const auto mask = decode_png(image.png, 10'000'000);
      if (!mask) return tl::unexpected{mask.error()};
      area += std::accumulate(mask->pixels.begin(), mask->pixels.end(), 0.0) / 255;
      return {};
    };
    const SystemClock clock;
    const auto planned = plan_job(stack, machine, options, sink, clock, {}, {});
    EXPECT_TRUE(planned) << planned.error().what;
    return area * machine.projection.pixel_pitch_mm * machine.projection.pixel_pitch_mm;
  };
  EXPECT_NEAR(lit_mm2(0) - lit_mm2(0.2), 2 * (2 * (7 + 10) * 0.2 + 3.14159 * 0.04), 0.1);
}

}  // namespace
}  // namespace telefab::fab
