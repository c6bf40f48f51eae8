// SPDX-License-Identifier: GPL-3.0-or-later
#include <gmock/gmock.h>

#include <algorithm>
#include <cmath>
#include <numbers>
#include <telefab/fab/cure/narrow_places.hpp>

namespace telefab::fab {
namespace {

using Kind = NarrowPlace::Kind;

Contour ring(std::vector<Point2> vertices) { return Contour::from_vertices(std::move(vertices)).value(); }

Contour box(double x0, double y0, double x1, double y1) { return ring({{x0, y0}, {x1, y0}, {x1, y1}, {x0, y1}}); }

Contour reversed(const Contour& c) { return ring({c.vertices().rbegin(), c.vertices().rend()}); }

Contour turned(const Contour& c, double angle) {
  std::vector<Point2> vertices;
  for (const Point2 p : c.vertices())
    vertices.push_back({20 + p.x_mm * std::cos(angle) - p.y_mm * std::sin(angle),
                        20 + p.x_mm * std::sin(angle) + p.y_mm * std::cos(angle)});
  return ring(std::move(vertices));
}

Contour disc(Point2 centre, double radius, int corners = 64) {
  std::vector<Point2> vertices;
  for (int i = 0; i < corners; ++i) {
    const double a = 2 * std::numbers::pi * i / corners;
    vertices.push_back({centre.x_mm + radius * std::cos(a), centre.y_mm + radius * std::sin(a)});
  }
  return ring(std::move(vertices));
}

std::vector<NarrowPlace> found(const std::vector<Contour>& rings) { return narrow_places(rings, 0.2, 0.1); }

double length_of(const std::vector<NarrowPlace>& places, Kind kind) {
  double length = 0;
  for (const NarrowPlace& place : places) length += place.kind == kind ? place.length_mm : 0;
  return length;
}

class NarrowPlacesAtAngle : public testing::TestWithParam<int> {
 protected:
  [[nodiscard]] double angle() const { return GetParam() * std::numbers::pi / 180; }
};

TEST_P(NarrowPlacesAtAngle, AWallIsFoundAlongItsLengthWithItsWidthAndMiddle) {
  const auto places = found({turned(box(0, 0, 5, 0.13), angle())});
  EXPECT_NEAR(length_of(places, Kind::Wall), 5, 0.25);
  for (const NarrowPlace& place : places) {
    EXPECT_EQ(place.kind, Kind::Wall);
    EXPECT_NEAR(place.width_mm, 0.13, 1e-9);
    const double dx = place.middle.x_mm - 20, dy = place.middle.y_mm - 20;
    EXPECT_NEAR(dy * std::cos(angle()) - dx * std::sin(angle()), 0.065, 1e-9);
  }
}

TEST_P(NarrowPlacesAtAngle, AGapBetweenTwoBlocksIsFoundAndTheBlocksAreNoWalls) {
  const auto places = found({turned(box(0, 0, 5, 3), angle()), turned(box(0, 3.08, 5, 6), angle())});
  EXPECT_NEAR(length_of(places, Kind::Gap), 5, 0.25);
  EXPECT_EQ(length_of(places, Kind::Wall), 0);
}

TEST_P(NarrowPlacesAtAngle, ASlotAndTheWallBesideAHoleAreFound) {
  const Contour block = turned(box(0, 0, 6, 6), angle());
  const auto slot = found({block, reversed(turned(box(1, 3, 5, 3.1), angle()))});
  EXPECT_NEAR(length_of(slot, Kind::Gap), 4, 0.25);
  EXPECT_EQ(length_of(slot, Kind::Wall), 0);
  const auto wall = found({block, reversed(turned(box(1, 0.1, 5, 5), angle()))});
  EXPECT_NEAR(length_of(wall, Kind::Wall), 4, 0.25);
  EXPECT_EQ(length_of(wall, Kind::Gap), 0);
}
INSTANTIATE_TEST_SUITE_P(Angles, NarrowPlacesAtAngle, testing::Values(0, 7, 22, 45, 90, 133));

TEST(NarrowPlaces, CornersAndRoundThingsHaveNone) {
  EXPECT_TRUE(found({box(0, 0, 3, 3)}).empty());
  EXPECT_TRUE(found({ring({{0, 0}, {3, 0}, {1.5, 2.6}})}).empty());  // corners of 60 degrees
  EXPECT_TRUE(found({disc({5, 5}, 2), reversed(disc({5, 5}, 1))}).empty());
}

TEST(NarrowPlaces, ALongSpikeIsAWallButItsVeryTipIsNot) {
  const auto places = found({ring({{0, 0}, {10, 0.5}, {0, 1}})});
  ASSERT_FALSE(places.empty());
  for (const NarrowPlace& place : places) {
    EXPECT_GE(place.width_mm, 0.014);  // at 1.5 x 0.2 / 2 mm from the tip
    EXPECT_NEAR(place.middle.y_mm, 0.5, 0.01);
  }
}

TEST(NarrowPlaces, AWallThatTouchesNothingWiderThanAskedForIsNotFound) {
  EXPECT_TRUE(found({box(0, 0, 5, 0.21)}).empty());
  EXPECT_FALSE(found({box(0, 0, 5, 0.19)}).empty());
}

TEST(NarrowPlaces, ASpeckIsOneWallAndAPinholeOneGap) {
  const auto places = found({disc({1, 1}, 0.06), box(2, 0, 4, 2), reversed(disc({3, 1}, 0.07))});
  ASSERT_EQ(places.size(), 2U);
  EXPECT_EQ(places[0].kind, Kind::Wall);
  EXPECT_NEAR(places[0].width_mm, 0.12, 0.001);
  EXPECT_NEAR(places[0].middle.x_mm, 1, 1e-9);
  EXPECT_EQ(places[1].kind, Kind::Gap);
  EXPECT_NEAR(places[1].width_mm, 0.14, 0.001);
}

TEST(NarrowPlaces, OfAHugeAndSparseLayerCostNoMoreThanItsContours) {
  const auto places = narrow_places(std::vector{box(0, 0, 0.1, 5), box(9000, 9000, 9000.1, 9005)}, 0.2, 0.1);
  EXPECT_NEAR(length_of(places, Kind::Wall), 10, 0.5);
}

TEST(NarrowPlaces, OfNothingAreNone) { EXPECT_TRUE(narrow_places({}, 0.2, 0.1).empty()); }

}  // namespace
}  // namespace telefab::fab
