// SPDX-License-Identifier: GPL-3.0-or-later
#include <gtest/gtest.h>

#include <numbers>
#include <telefab/fab/region/region.hpp>

namespace telefab::fab {
namespace {

Contour box(double x, double y, double side, bool hole = false) {
  std::vector<Point2> v{{x, y}, {x + side, y}, {x + side, y + side}, {x, y + side}};
  if (hole) std::reverse(v.begin(), v.end());
  return Contour::from_vertices(v).value();
}

Region region(std::vector<Contour> contours) { return Region::from_contours(contours).value(); }

TEST(Region, KeepsAHoleAndItsArea) {
  const Region ring = region({box(0, 0, 10), box(2, 2, 6, true)});
  EXPECT_NEAR(ring.area_mm2(), 64, 1e-9);
  EXPECT_TRUE(ring.contains({1, 1}));
  EXPECT_FALSE(ring.contains({5, 5}));
  EXPECT_EQ(ring.to_contours().size(), 2U);
}

TEST(Region, JoinsOverlappingAndTouchingOuters) {
  EXPECT_NEAR(region({box(0, 0, 2), box(1, 0, 2)}).area_mm2(), 6, 1e-9);
  EXPECT_EQ(region({box(0, 0, 2), box(2, 0, 2)}).pieces().size(), 1U);
  EXPECT_EQ(region({box(0, 0, 2), box(3, 0, 2)}).pieces().size(), 2U);
}

TEST(Region, DropsAHoleWithoutAnOuter) { EXPECT_TRUE(region({box(0, 0, 2, true)}).empty()); }

TEST(Region, GivesEachPieceItsHolesAndTheIslandInsideAHoleItsOwnPiece) {
  const Region nested = region({box(0, 0, 10), box(1, 1, 8, true), box(3, 3, 4)});
  const auto pieces = nested.pieces();
  ASSERT_EQ(pieces.size(), 2U);
  EXPECT_NEAR(pieces[0].area_mm2(), 36, 1e-9);
  EXPECT_NEAR(pieces[1].area_mm2(), 16, 1e-9);
}

TEST(Region, OffsetsADiscByGrowingItsRadius) {
  const Region grown = offset(disc({5, 5}, Millimetres{2}, Millimetres{1e-4}), Millimetres{1}, Millimetres{1e-4});
  EXPECT_NEAR(grown.area_mm2(), std::numbers::pi * 9, 0.01);
}

TEST(Region, LosesAThinPartWhenOffsetInwards) {
  const Region thin = region({Contour::from_vertices({{0, 0}, {10, 0}, {10, 0.2}, {0, 0.2}}).value()});
  EXPECT_TRUE(offset(thin, Millimetres{-0.11}, Millimetres{1e-3}).empty());
}

TEST(Region, SimplifiesWithoutMovingTheBoundaryFurtherThanTold) {
  const Region fine = disc({0, 0}, Millimetres{10}, Millimetres{1e-5});
  const Region coarse = simplified(fine, Millimetres{0.01});
  EXPECT_LT(coarse.rings()[0].size() * 10, fine.rings()[0].size());
  EXPECT_TRUE(subtract(fine, offset(coarse, Millimetres{0.0101}, Millimetres{1e-4})).empty());
}

TEST(Region, UnitesThousandsOfDiscsToWhatOneByOneWouldGive) {
  // A quarter of them overlap their neighbours, the others stand alone.
  std::vector<Region> discs;
  Region slowly;
  for (int i = 0; i < 400; ++i) {
    const double x = (i % 20) * 3 + (i % 4 == 0 ? 1.2 : 0.0), y = (i / 20) * 3;
    discs.push_back(disc({x, y}, Millimetres{1}, Millimetres{0.02}));
    slowly = unite(slowly, discs.back());
  }
  const Region at_once = unite(discs);
  EXPECT_NEAR(at_once.area_mm2(), slowly.area_mm2(), 1e-4);
  EXPECT_LT(subtract(at_once, slowly).area_mm2(), 1e-4);
  EXPECT_EQ(at_once.pieces().size(), slowly.pieces().size());
  // Only those in the band of the cut are left out.
  const Region cut = subtract(at_once, region({box(-5, -5, 20)}));
  EXPECT_NEAR(cut.area_mm2() + intersect(at_once, region({box(-5, -5, 20)})).area_mm2(), at_once.area_mm2(), 1e-4);
}

TEST(Region, RefusesCoordinatesBeyondTheLimit) { EXPECT_FALSE(Region::from_contours(std::vector{box(0, 0, 1e7)})); }

TEST(Region, KnowsAPointInsideEachPiece) {
  for (const Region& piece : region({box(0, 0, 10), box(1, 1, 8, true), box(3, 3, 4)}).pieces()) {
    EXPECT_TRUE(piece.contains(inner_point(piece)));
  }
}

TEST(Region, AnswersForNothing) {
  const Region none;
  EXPECT_EQ(none.area_mm2(), 0);
  EXPECT_TRUE(unite(none, none).empty());
  EXPECT_TRUE(intersect(none, region({box(0, 0, 1)})).empty());
  EXPECT_TRUE(none.pieces().empty());
  EXPECT_FALSE(none.contains({0, 0}));
}

}  // namespace
}  // namespace telefab::fab
