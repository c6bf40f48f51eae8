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

TEST(Region, UnitesManyDiscsAsOneAfterTheOther) {
  // Rows of discs: some stand alone, some overlap, and one square with a hole lies around a disc and beside another.
  std::vector<Region> discs;
  for (int i = 0; i < 12; ++i)
    for (int j = 0; j < 12; ++j)
      discs.push_back(
          disc({3.0 * i + 0.1 * j, 3.0 * j}, Millimetres{0.6 + 0.1 * ((i * 5 + j) % 12)}, Millimetres{0.005}));
  discs.push_back(region({box(40, 40, 10), box(41, 41, 8, true)}));
  discs.push_back(disc({45, 45}, Millimetres{1}, Millimetres{0.005}));
  discs.push_back(disc({50, 45}, Millimetres{1}, Millimetres{0.005}));
  Region one_by_one;
  for (const Region& each : discs) one_by_one = unite(one_by_one, each);
  const Region together = unite(discs);
  EXPECT_EQ(together.pieces().size(), one_by_one.pieces().size());
  EXPECT_LT(together.pieces().size(), 140U) << "some overlap";
  EXPECT_GT(together.pieces().size(), 20U) << "some stand alone";
  EXPECT_NEAR(together.area_mm2(), one_by_one.area_mm2(), 1e-6);
  EXPECT_NEAR(subtract(together, one_by_one).area_mm2() + subtract(one_by_one, together).area_mm2(), 0, 1e-4);
}

TEST(Region, UnitesManyRingsOfAnyShapeAndSenseOnce) {
  // Rings that a union changes though they stand alone: a hole in nothing, a bow, one with a vertex on its edge.
  std::vector<Region> many;
  for (int i = 0; i < 70; ++i) many.push_back(disc({3.0 * i, 0}, Millimetres{1}, Millimetres{0.005}));
  many.push_back(region({box(0, 10, 4)}));
  many.push_back(
      region({Contour::from_vertices({{10, 10}, {12, 10}, {14, 10}, {14, 14}, {12, 11}, {10, 14}}).value()}));
  const Region united = unite(many);
  EXPECT_EQ(united.pieces().size(), 72U);
  EXPECT_TRUE(united.contains({3, 0}));
  EXPECT_FALSE(united.contains({12, 12}));
  EXPECT_EQ(united.to_contours(), unite(united, Region{}).to_contours());
}

TEST(Region, TakesAwayFromWhatIsMetAndLeavesTheRestAsItIs) {
  std::vector<Region> many;
  for (int i = 0; i < 40; ++i) many.push_back(disc({3.0 * i, 0}, Millimetres{1}, Millimetres{0.005}));
  const Region all = unite(many), cut = subtract(all, region({box(2, -1, 1)}));
  ASSERT_EQ(cut.pieces().size(), 40U);
  EXPECT_NEAR(all.area_mm2() - cut.area_mm2(), many[1].area_mm2() / 4, 1e-3);
  const auto before = all.to_contours(), after = cut.to_contours();
  std::size_t unchanged = 0;
  for (const Contour& ring : after) unchanged += std::find(before.begin(), before.end(), ring) != before.end();
  EXPECT_EQ(unchanged, 39U);
}

}  // namespace
}  // namespace telefab::fab
