// SPDX-License-Identifier: GPL-3.0-or-later
#include "doubtful_places.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>

namespace telefab::scan {
namespace {

constexpr int kCount = 360;

Contour circle(double x, double radius) {
  std::vector<Point2> vertices;
  for (int i = 0; i < kCount; ++i) {
    const double a = 2 * std::numbers::pi * i / kCount;
    vertices.push_back({x + radius * std::cos(a), radius * std::sin(a)});
  }
  return *Contour::from_vertices(std::move(vertices));
}

/// Two balls that have just met: their outlines with a neck of half this width.
Contour joined(double half_neck) {
  std::vector<Point2> vertices;
  const double open = std::asin(half_neck / 10);
  for (int side = 0; side < 2; ++side)
    for (int i = 0; i <= kCount; ++i) {
      const double a = (side == 0 ? 0 : std::numbers::pi) + open + (2 * std::numbers::pi - 2 * open) * i / kCount;
      vertices.push_back({(side == 0 ? -10 : 10) + 10 * std::cos(a), 10 * std::sin(a)});
    }
  return *Contour::from_vertices(std::move(vertices));
}

Layer layer_of(std::vector<Contour> contours) {
  Layer layer;
  layer.contours = std::move(contours);
  layer.certificate.flag({.reason = DoubtReason::KernelsDisagree});
  return layer;
}

TEST(DoubtfulPlaces, MarkWhatRunsInReachAndLeaveTheRest) {
  Layer layer = layer_of({circle(0, 10), circle(40, 10)});
  DoubtfulPlaces where;
  where.add({10, 0}, 1);
  ASSERT_TRUE(where.mark(layer));
  EXPECT_NEAR(surface_shares(layer).doubtful_mm, 2, 0.6);
  EXPECT_TRUE(layer.contours[1].runs().empty());
}

TEST(DoubtfulPlaces, MarkTheNearestEdgeWhereNoneIsInReach) {
  Layer layer = layer_of({circle(0, 10), circle(40, 10)});
  DoubtfulPlaces where;
  where.add({52, 0}, 1);
  ASSERT_TRUE(where.mark(layer));
  EXPECT_TRUE(layer.contours[0].runs().empty());
  EXPECT_GT(surface_shares(layer).doubtful_mm, 0);
  EXPECT_LT(surface_shares(layer).doubtful_mm, 0.5);
}

TEST(DoubtfulPlaces, MarkTheNeckWhereOneSawOneRingAndTheOtherTwo) {
  Layer layer = layer_of({joined(0.8)});
  const std::vector<Contour> other{circle(-10, 9.99), circle(10, 9.99)};
  DoubtfulPlaces where;
  const auto place = where.add_difference(layer.contours, other, 0.4);
  ASSERT_TRUE(place);
  EXPECT_LT(std::abs(place->x_mm), 3);
  ASSERT_TRUE(where.mark(layer));
  EXPECT_GT(surface_shares(layer).doubtful_mm, 0);
  EXPECT_LT(surface_shares(layer).doubtful_mm, 0.1 * surface_shares(layer).length_mm());
}

TEST(DoubtfulPlaces, MarkARingThatTheOtherLacks) {
  Layer layer = layer_of({circle(0, 10), circle(40, 2)});
  const std::vector<Contour> other{circle(0, 10)};
  DoubtfulPlaces where;
  where.add_difference(layer.contours, other, 0.4);
  ASSERT_TRUE(where.mark(layer));
  EXPECT_TRUE(layer.contours[0].runs().empty());
  ASSERT_EQ(layer.contours[1].runs().size(), 1U);
  EXPECT_EQ(layer.contours[1].runs()[0].kind, SurfaceClass::Doubtful);
}

TEST(DoubtfulPlaces, MarkAllWhereNothingTellsThePlace) {
  Layer layer = layer_of({circle(0, 10)});
  DoubtfulPlaces where;
  EXPECT_FALSE(where.add_difference(layer.contours, layer.contours, 0.4));
  ASSERT_TRUE(where.mark(layer));
  EXPECT_EQ(surface_shares(layer).doubtful_mm, surface_shares(layer).length_mm());
}

TEST(DoubtfulPlaces, LeaveALayerWithoutContoursAsItIs) {
  Layer layer = layer_of({});
  DoubtfulPlaces where;
  where.add({0, 0}, 1);
  EXPECT_TRUE(where.mark(layer));
}

}  // namespace
}  // namespace telefab::scan
