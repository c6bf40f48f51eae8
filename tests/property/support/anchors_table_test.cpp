// SPDX-License-Identifier: GPL-3.0-or-later
#include <gtest/gtest.h>

#include <algorithm>
#include <telefab/fab/support/covering.hpp>

#include "irregular_regions.hpp"

namespace telefab::fab {
namespace {

/// Independent of the solver: what discs of the anchor distance leave open.
double open_mm2(const Region& region, const std::vector<Point2>& anchors) {
  std::vector<Region> discs;
  for (const Point2& a : anchors) discs.push_back(disc(a, Millimetres{1}, Millimetres{2e-4}));
  return subtract(region, unite(discs)).area_mm2();
}

TEST(AnchorsTable, HasAtLeast28PercentFewerThanAGridInTheMedianAndNeverMore) {
  std::vector<double> saved;
  for (const shapes::Named& shape : shapes::twelve()) {
    CoveringOptions options;
    options.anchor_distance = Millimetres{1};
    const auto ours = cover_region(shape.region, options, {});
    ASSERT_TRUE(ours) << shape.name;
    const auto grid = grid_covering(shape.region, options.anchor_distance);
    EXPECT_LT(open_mm2(shape.region, ours->anchors), 1e-9) << shape.name;
    EXPECT_LT(open_mm2(shape.region, grid), 1e-2) << shape.name;
    EXPECT_LE(ours->anchors.size(), grid.size()) << shape.name;
    saved.push_back(1 - static_cast<double>(ours->anchors.size()) / static_cast<double>(grid.size()));
    if (shape.region.area_mm2() > 200) {
      EXPECT_LE(static_cast<double>(ours->anchors.size()),
                1.27 * covering_lower_bound(shape.region, options.anchor_distance))
          << shape.name;
    }
  }
  std::sort(saved.begin(), saved.end());
  ASSERT_EQ(saved.size(), 12U);
  EXPECT_GE((saved[5] + saved[6]) / 2, 0.28);
}

}  // namespace
}  // namespace telefab::fab
