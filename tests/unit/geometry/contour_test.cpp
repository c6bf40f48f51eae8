// SPDX-License-Identifier: GPL-3.0-or-later
#include <gtest/gtest.h>

#include <limits>
#include <telefab/geometry/contour.hpp>

namespace telefab {

TEST(Bounds2, StaysAsItIsWhereTheOtherHoldsNothing) {
  const Bounds2 box{{1, 2}, {3, 4}};
  Bounds2 grown = box;
  grown.include(Bounds2::nothing());
  EXPECT_EQ(grown, box);
  Bounds2 from_nothing = Bounds2::nothing();
  from_nothing.include(Bounds2::nothing());
  EXPECT_TRUE(from_nothing.is_nothing());
  from_nothing.include(box);
  EXPECT_EQ(from_nothing, box);
}

TEST(Contour, RefusesTwoVertices) {
  EXPECT_EQ(Contour::from_vertices({{0, 0}, {1, 0}}).error().code, ErrorCode::InvalidInput);
}

TEST(Contour, RefusesVerticesThatAreNotFiniteOrRepeat) {
  EXPECT_FALSE(Contour::from_vertices({{0, 0}, {1, 0}, {1, std::numeric_limits<double>::quiet_NaN()}}));
  EXPECT_FALSE(Contour::from_vertices({{0, 0}, {1, 0}, {1, 1}, {0, 0}}));
}

TEST(Contour, RefusesARingWithoutArea) { EXPECT_FALSE(Contour::from_vertices({{0, 0}, {1, 0}, {2, 0}})); }

TEST(Contour, TellsHolesFromOuterRingsByTheirTurn) {
  const auto outer = Contour::from_vertices({{0, 0}, {2, 0}, {2, 3}, {0, 3}}).value();
  const auto hole = Contour::from_vertices({{0, 0}, {0, 3}, {2, 3}, {2, 0}}).value();
  EXPECT_DOUBLE_EQ(outer.signed_area_mm2(), 6);
  EXPECT_FALSE(outer.is_hole());
  EXPECT_DOUBLE_EQ(hole.signed_area_mm2(), -6);
  EXPECT_TRUE(hole.is_hole());
  EXPECT_DOUBLE_EQ(outer.length_mm(), 10);
}

TEST(Contour, ContainsItsInsideOnly) {
  const auto ring = Contour::from_vertices({{0, 0}, {2, 0}, {2, 2}, {1, 1}, {0, 2}}).value();
  EXPECT_TRUE(contains(ring, {1, 0.5}));
  EXPECT_FALSE(contains(ring, {1, 1.5}));
  EXPECT_FALSE(contains(ring, {3, 1}));
}

}  // namespace telefab
