// SPDX-License-Identifier: GPL-3.0-or-later
#include <gtest/gtest.h>

#include <numbers>
#include <random>
#include <telefab/fab/support/covering.hpp>

#include "stacks.hpp"

namespace telefab::fab {
namespace {

Region region(std::vector<std::vector<Point2>> rings) {
  std::vector<Contour> contours;
  for (auto& ring : rings) contours.push_back(Contour::from_vertices(ring).value());
  return Region::from_contours(contours).value();
}

std::vector<Point2> reversed(std::vector<Point2> ring) {
  std::reverse(ring.begin(), ring.end());
  return ring;
}

/// Independent of the solver: the region minus all discs.
double left_over_mm2(const Region& r, const std::vector<Point2>& anchors, double reach) {
  std::vector<Region> discs;
  for (const Point2& a : anchors) discs.push_back(disc(a, Millimetres{reach}, Millimetres{reach / 5000}));
  return subtract(r, unite(discs)).area_mm2();
}

std::vector<Region> shapes() {
  return {
      region({stacks::box(0, 0, 30, 30)}),
      region({stacks::box(0, 0, 60, 0.4)}),
      region({{{0, 0}, {30, 0}, {30, 6}, {6, 6}, {6, 30}, {0, 30}}}),
      region({stacks::circle(0, 0, 15, 200), reversed(stacks::circle(0, 0, 12, 200))}),
      region({{{0, 0}, {40, 0.1}, {40, 0.2}, {1, 2}}}),
      region({stacks::box(0, 0, 5, 5), stacks::box(40, 40, 46, 41)}),
      region({stacks::circle(0, 0, 0.05, 8)}),
  };
}

TEST(Covering, ReachesEveryPointOfEveryShapeWithAnchorsInside) {
  for (const Region& shape : shapes()) {
    CoveringOptions options;
    options.anchor_distance = Millimetres{3};
    const auto covering = cover_region(shape, options, {});
    ASSERT_TRUE(covering);
    ASSERT_FALSE(covering->anchors.empty());
    EXPECT_LT(left_over_mm2(shape, covering->anchors, 3), 1e-6) << shape.area_mm2();
    EXPECT_LE(covering->worst_mm, 3);
    for (const Point2& a : covering->anchors) EXPECT_TRUE(shape.contains(a)) << a.x_mm << ' ' << a.y_mm;
  }
}

TEST(Covering, PutsNoAnchorOutsideWhatStandingAnchorsLeaveOpen) {
  // Thin bands with bites: cells with corners on the region's own edges.
  std::mt19937 random{5};
  const auto number = [&](double low, double high) {
    return low + (high - low) * std::generate_canonical<double, 32>(random);
  };
  for (int round = 0; round < 150; ++round) {
    const double turn = number(0, 6), width = number(0.5, 4);
    std::vector<Point2> band;
    for (int i = 0; i < 60; ++i) {
      const double t = 2 * std::numbers::pi * i / 60, x = 16 * std::cos(t), y = width * std::sin(t);
      band.push_back({x * std::cos(turn) - y * std::sin(turn), x * std::sin(turn) + y * std::cos(turn)});
    }
    std::vector<Region> held;
    for (int i = 0; i < 6; ++i) {
      const double s = number(-14, 14), off = number(-2, 2);
      held.push_back(disc({s * std::cos(turn) - off * std::sin(turn), s * std::sin(turn) + off * std::cos(turn)},
                          Millimetres{number(2, 3)}, Millimetres{0.006}));
    }
    const Region open = subtract(region({band}), unite(held));
    const auto covering = cover_region(open, {}, {});
    ASSERT_TRUE(covering);
    EXPECT_LT(left_over_mm2(open, covering->anchors, 3), 1e-6) << round;
    const Region rounded = offset(open, Millimetres{1e-3}, Millimetres{1e-4});
    for (const Point2& a : covering->anchors)
      EXPECT_TRUE(rounded.contains(a)) << round << ": " << a.x_mm << ' ' << a.y_mm;
    EXPECT_LE(covering->anchors.size(), grid_covering(open, Millimetres{3}).size()) << round;
  }
}

TEST(Covering, NeverNeedsMoreAnchorsThanAGrid) {
  for (const Region& shape : shapes()) {
    const auto covering = cover_region(shape, {}, {});
    const auto grid = grid_covering(shape, Millimetres{3});
    EXPECT_LE(covering->anchors.size(), grid.size());
    EXPECT_LT(left_over_mm2(shape, grid, 3), 1e-2);
  }
}

TEST(Covering, ComesNearTheLowerBoundOnALargeRegion) {
  const Region large = region({stacks::box(0, 0, 60, 45)});  // 300 r^2
  const auto covering = cover_region(large, {}, {});
  EXPECT_LE(static_cast<double>(covering->anchors.size()), 1.27 * covering_lower_bound(large, Millimetres{3}));
}

TEST(Covering, HoldsASmallSpotByOneAnchor) {
  EXPECT_EQ(cover_region(region({stacks::circle(5, 5, 2.9)}), {}, {})->anchors.size(), 1U);
}

TEST(Covering, OfNothingIsNothing) { EXPECT_TRUE(cover_region({}, {}, {})->anchors.empty()); }

TEST(Covering, RefusesAnImpossibleDistanceAndAnEndlessCount) {
  CoveringOptions options;
  options.anchor_distance = Millimetres{0};
  EXPECT_EQ(cover_region(shapes()[0], options, {}).error().code, ErrorCode::InvalidInput);
  options.anchor_distance = Millimetres{1e-3};
  EXPECT_EQ(cover_region(shapes()[0], options, {}).error().code, ErrorCode::TooLarge);
}

TEST(Covering, GivesTheSameAnchorsEveryTime) {
  for (const Region& shape : shapes())
    EXPECT_EQ(cover_region(shape, {}, {})->anchors, cover_region(shape, {}, {})->anchors);
}

}  // namespace
}  // namespace telefab::fab
