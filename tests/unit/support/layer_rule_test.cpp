// SPDX-License-Identifier: GPL-3.0-or-later
#include <gtest/gtest.h>

#include <telefab/fab/support/layer_rule.hpp>

#include "stacks.hpp"

namespace telefab::fab {
namespace {

Region region(std::vector<std::vector<Point2>> rings) {
  std::vector<Contour> contours;
  for (auto& ring : rings) contours.push_back(Contour::from_vertices(ring).value());
  return Region::from_contours(contours).value();
}

SelfSupportLaw law() {
  SelfSupportLaw l;
  l.least = Millimetres{0.2};
  l.growth_per_mm = 0.1;
  l.most = Millimetres{1};
  return l;
}

TEST(SelfSupportLaw, GrowsWithTheAttachedAreaUpToItsMost) {
  EXPECT_DOUBLE_EQ(law().reach(0).count(), 0.2);
  EXPECT_DOUBLE_EQ(law().reach(100).count(), 0.4);
  EXPECT_DOUBLE_EQ(law().reach(1e8).count(), 1);
}

TEST(LayerRule, SplitsALayerIntoAttachedSelfSupportedAndTheRest) {
  const auto found = analyse_layer(region({stacks::box(0, 0, 10, 10)}), region({stacks::box(0, 0, 15, 10)}), law());
  EXPECT_NEAR(found.attached.area_mm2(), 100, 1e-6);
  EXPECT_NEAR(found.self_supported.area_mm2(), 104, 1e-6);
  EXPECT_NEAR(found.to_support.area_mm2(), 46, 1e-2);
  EXPECT_NEAR(found.to_support.bounds().min.x_mm, 10.4, 1e-3);
}

TEST(LayerRule, LeavesASmallOverhangToItself) {
  const auto found =
      analyse_layer(region({stacks::box(0, 0, 10, 10)}), region({stacks::box(-0.3, 0, 10.35, 10.1)}), law());
  EXPECT_TRUE(found.to_support.empty());
  EXPECT_NEAR(found.self_supported.area_mm2(), 10.65 * 10.1, 1e-6);
}

TEST(LayerRule, SupportsAllOfALayerWithNothingBelow) {
  EXPECT_NEAR(analyse_layer({}, region({stacks::box(0, 0, 4, 4)}), law()).to_support.area_mm2(), 16, 1e-2);
}

TEST(LayerRule, GivesEachAttachedPieceItsOwnReach) {
  const Region below = region({stacks::box(0, 0, 1, 1), stacks::box(20, 0, 30, 10)});
  const Region current = region({stacks::box(0, 0, 5, 1), stacks::box(15, 0, 30, 10)});
  const auto found = analyse_layer(below, current, law());
  // The small piece reaches 0.22 mm, the large one 0.4 mm.
  EXPECT_NEAR(found.to_support.area_mm2(), (4 - 0.22) * 1 + (5 - 0.4) * 10, 2e-2);
}

TEST(LayerRule, DoesNotTrustAContactTooSmallForAPixel) {
  const Region below = region({stacks::box(0, 0, 0.1, 0.1)});
  EXPECT_NEAR(analyse_layer(below, region({stacks::box(0, 0, 4, 4)}), law()).to_support.area_mm2(), 16, 1e-2);
}

TEST(LayerRule, CallsAThinStripBesideABodyAnIslandAlthoughTheBodyReachesAcrossTheGap) {
  const Region below = region({stacks::box(0, 0, 10, 10)});
  const auto strip = [](double width) {
    return region({stacks::box(0, 0, 10, 10), stacks::box(10.1, 2, 10.1 + width, 4)});
  };
  const auto found = analyse_layer(below, strip(0.1), law());
  ASSERT_EQ(found.islands.size(), 1U);
  EXPECT_NEAR(found.islands[0].area_mm2(), 0.2, 1e-3);
  EXPECT_NEAR(found.to_support.area_mm2(), 0.2, 1e-2);
  EXPECT_TRUE(analyse_layer(below, strip(0.05), law()).islands.empty());  // nothing a mask could show
}

TEST(LayerRule, LetsASpeckRestThatLiesOnTheLayerBelowAsAWhole) {
  SelfSupportLaw fine = law();
  fine.contact = Millimetres{0.5};
  const auto found = analyse_layer(region({stacks::box(0, 0, 4, 4)}),
                                   region({stacks::box(1, 1, 1.3, 1.3), stacks::box(8, 8, 8.3, 8.3)}), fine);
  ASSERT_EQ(found.islands.size(), 1U);
  EXPECT_NEAR(found.islands.front().bounds().min.x_mm, 8, 0.1);
}

TEST(WithoutSpecks, TakesAFloatingSpeckOutSoThatWhatGrowsFromItIsAnIsland) {
  std::vector<Region> layers{region({stacks::box(0, 0, 9, 9)}),
                             region({stacks::box(0, 0, 9, 9), stacks::box(20, 20, 20.1, 20.1)}),
                             region({stacks::box(0, 0, 9, 9), stacks::box(20, 20, 21, 21)})};
  const auto kept = without_specks(layers, 0.04);
  EXPECT_EQ(kept[1].pieces().size(), 1U);
  EXPECT_EQ(kept[2].pieces().size(), 2U);
}

}  // namespace
}  // namespace telefab::fab
