// SPDX-License-Identifier: GPL-3.0-or-later
#include <gmock/gmock.h>
#include <tbb/global_control.h>

#include <algorithm>
#include <cmath>
#include <numbers>
#include <telefab/test/blocks.hpp>

namespace telefab::fab {
namespace {

using test::Block;
using test::judged;
using Check = CarryPlace::Check;

/// Four square tips of 1 mm, their middles 6 mm apart around (10, 10), each on the platform.
std::vector<Block> four_tips(std::uint32_t behind) {
  std::vector<Block> blocks;
  for (const double x : {7.0, 13.0})
    for (const double y : {7.0, 13.0}) blocks.push_back({x - 0.5, y - 0.5, x + 0.5, y + 0.5, 0, behind});
  return blocks;
}

TEST(CarryWatch, ABlockOverTheMiddleOfFourTipsAsksOfThemItsAreaOverTheirs) {
  auto blocks = four_tips(4);
  blocks.push_back({4, 6, 16, 14, 4, 8});
  const CarryReport report = judged(blocks);
  EXPECT_NEAR(report.cut->demand, 24, 1e-9);
  EXPECT_NEAR(report.lever->demand, 24, 1e-9);
  EXPECT_EQ(report.cut->layer.count(), 1U) << "all sections of a tip are alike: the lowest";
  EXPECT_NEAR(report.cut->held_mm2, 96, 1e-9);
  EXPECT_NEAR(report.base_mm2, 4, 1e-9);
}

TEST(CarryWatch, ABlockBesideTheMiddleOfFourTipsAsksMoreOfTheNearOnes) {
  auto blocks = four_tips(4);
  blocks.push_back({6, 6, 18, 14, 4, 8});
  const CarryReport report = judged(blocks);
  EXPECT_NEAR(report.cut->demand, 24, 1e-9);
  // 2 mm off, springs at +-3 mm with 1/12 mm2 of their own.
  EXPECT_NEAR(report.lever->demand, 24 * (1 + 3 * 2 / (9 + 1.0 / 12)), 1e-6);
  EXPECT_NEAR(report.lever->place.x_mm, 13, 1e-9);
  EXPECT_NEAR(report.bending->demand, 24 * (1 + 3.5 * 2 / (9 + 1.0 / 12)), 1e-6);
}

TEST(CarryWatch, TipsAtFourHeightsAreOneCutThatNoLevelSectionShows) {
  // Posts of 2 mm, each with a tip of 1 mm on it under its quarter of a block.
  std::vector<Block> blocks;
  std::uint32_t top = 4;
  for (const double x : {6.0, 10.0})
    for (const double y : {6.0, 10.0}) {
      blocks.push_back({x + 1, y + 1, x + 3, y + 3, 0, top});
      blocks.push_back({x + 1.5, y + 1.5, x + 2.5, y + 2.5, top, top + 2});
      blocks.push_back({x, y, x + 4, y + 4, top + 2, 24});
      top += 4;
    }
  const CarryReport report = judged(blocks);
  // Each quarter lies against one before it. One tip bears 16, and so do two, three and four.
  EXPECT_NEAR(report.cut->demand, 16, 1e-9);
  std::erase_if(blocks, [](const Block& b) { return b.x1 - b.x0 < 1.5 && b.first == 8; });
  blocks.push_back({7.7, 11.7, 8.3, 12.3, 8, 10});
  EXPECT_NEAR(judged(blocks).cut->demand, 32 / 1.36, 1e-9) << "two quarters on a tip and a thin tip";
}

TEST(CarryWatch, APlateBesideItsColumnBendsIt) {
  // 3.5 in the mean; the plate's middle is 2.5 mm off that of a column of 2 mm.
  const CarryReport report = judged({{6, 9, 8, 11, 0, 20}, {6, 9, 13, 11, 20, 23}});
  EXPECT_NEAR(report.cut->demand, 3.5, 1e-9);
  EXPECT_NEAR(report.bending->demand, 3.5 * (1 + 6 * 2.5 / 2), 1e-6);
  EXPECT_EQ(report.worst()->check, Check::Bending);
}

TEST(CarryWatch, AThickAndAThinTowerShareByTheirAreas) {
  // The pull is in the middle of both, 4 mm from either: the stiff one bears more, the thin one bends.
  const CarryReport report = judged({{2, 8, 6, 12, 0, 20}, {11, 9, 13, 11, 0, 20}, {2, 8, 13, 12, 20, 23}});
  const double g = (16 * 4.0 + 4 * 12.0) / 20, f = 7.5;
  const double i = 16 * ((4 - g) * (4 - g) + 16.0 / 12) + 4 * ((12 - g) * (12 - g) + 4.0 / 12);
  EXPECT_NEAR(report.cut->demand, 2.2, 1e-9);
  EXPECT_NEAR(report.lever->demand, 44 * (1.0 / 20 + (12 - g) * (f - g) / i), 1e-6);
}

TEST(CarryWatch, AStrutThatEndsInTheResinBearsNothing) {
  auto blocks = four_tips(4);
  blocks.push_back({4, 6, 16, 14, 4, 8});
  const CarryReport without = judged(blocks);
  blocks.push_back({9, 9, 11, 11, 2, 4});
  const CarryReport with = judged(blocks);
  EXPECT_NEAR(with.cut->demand, without.cut->demand, 1e-9);
  EXPECT_NEAR(with.bending->demand, without.bending->demand, 1e-9);
  EXPECT_NEAR(with.afloat_mm2, 4, 1e-9) << "while it is printed nothing holds it";
}

TEST(CarryWatch, TheWorstMomentMayComeBeforePiecesMerge) {
  // A plate of 24 mm2 on a tip of 0.36 mm2, until a wall joins it to a stout block.
  const std::vector<Block> blocks{
      {2, 2, 8, 18, 0, 12}, {13, 9, 13.6, 9.6, 0, 4}, {11, 6, 15, 12, 4, 8}, {2, 6, 15, 12, 8, 12}};
  const CarryReport report = judged(blocks);
  EXPECT_NEAR(report.cut->demand, 24 / 0.36, 1e-9);
  EXPECT_LT(report.cut->moment.count(), 8U);
  EXPECT_NEAR(report.cut->place.x_mm, 13.3, 1e-9);
}

TEST(CarryWatch, ALongPinIsSoftAndGivesItsLoadAway) {
  // Three tips of 1 mm2 in a row, the outer ones short, on blocks of 20 mm2.
  std::vector<Block> blocks{{4, 5, 6, 15, 0, 15}, {14, 5, 16, 15, 0, 15}};
  for (const double x : {5.0, 10.0, 15.0}) blocks.push_back({x - 0.5, 9.5, x + 0.5, 10.5, 0, 20});
  blocks.push_back({4, 6, 16, 14, 20, 22});
  const CarryReport report = judged(blocks);
  EXPECT_NEAR(report.cut->demand, 32, 1e-9);
  // 20 meetings of layers 0.5 mm apart under the middle; 6 and 14 under the others.
  const double outer = 1 / (6 * 0.5 + 14 * 0.5 / 20), middle = 1 / (20 * 0.5);
  EXPECT_NEAR(report.lever->demand, 96 * outer / (2 * outer + middle), 1e-6);
}

TEST(CarryWatch, TipsThatStandOnOnePinShareItsStiffness) {
  // Left and right two tips of 0.16 mm2 each on a pin of 2 mm2; in the middle one on a pin of 1 mm2: each tip has as
  // much.
  std::vector<Block> blocks{{9.5, 9.5, 10.5, 10.5, 0, 18}, {9.8, 9.8, 10.2, 10.2, 18, 20}, {2, 5, 18, 15, 20, 22}};
  for (const double x : {4.0, 14.0}) {
    blocks.push_back({x, 9.5, x + 2, 10.5, 0, 18});
    for (const double tip : {0.3, 1.3}) blocks.push_back({x + tip, 9.8, x + tip + 0.4, 10.2, 18, 20});
  }
  const CarryReport report = judged(blocks);
  EXPECT_NEAR(report.cut->demand, 160 / 0.8, 1e-9);
  EXPECT_NEAR(report.lever->demand, 160 / 0.8, 1e-6);
}

TEST(CarryWatch, WhatHangsOnAnArchIsHeldByItsNarrowestPlace) {
  // Two legs, a bar over them, and below the bar a bob that the light of later layers joined to it.
  const std::vector<Block> blocks{
      {4, 8, 6, 12, 0, 10}, {14, 8, 16, 12, 0, 10}, {4, 8, 16, 12, 10, 12}, {4, 8, 16, 12, 12, 14}};
  const CarryReport report = judged(blocks);
  EXPECT_NEAR(report.cut->demand, 48.0 / 16, 1e-9);
  EXPECT_EQ(report.afloat_mm2, 0);
}

TEST(CarryWatch, WhatHangsOnASectionHangsByItsWeightToo) {
  CarryOptions options{.weight_share = 0.01};
  const CarryReport report = judged({{9.5, 9.5, 10.5, 10.5, 0, 4}, {5, 5, 15, 15, 4, 8}}, options);
  // 100 mm2 are pulled, and four layers of them weigh a hundredth each.
  EXPECT_NEAR(report.cut->demand, 104, 0.05);
  EXPECT_NEAR(report.bending->demand, 104, 0.05);
}

TEST(CarryWatch, WhatLiesTowardsThePlatformHangsOnNothingFartherAway) {
  CarryOptions options{.weight_share = 0.05, .least_held_mm2 = 1};
  const CarryReport report =
      judged({{5, 5, 15, 15, 0, 10}, {9.5, 9.5, 10.5, 10.5, 10, 12}, {8.5, 8.5, 11.5, 11.5, 12, 14}}, options);
  // On the neck a head of 9 mm2 and two layers; the block below it would be 50.
  EXPECT_NEAR(report.cut->demand, 9 * 1.1, 0.11);
  EXPECT_NEAR(report.bending->demand, 9 * 1.1, 0.11);
}

/// A cup that opens away from the platform, 10 mm wide, its hollow 8, on a post of 4 mm2.
std::vector<Block> cup(double slot_mm) {
  return {{9, 9, 11, 11, 0, 3}, {5, 5, 15, 15, 3, 5}, {5, 5, 6, 15, 5, 9}, {14, 5 + slot_mm, 15, 15, 5, 9},
          {5, 5, 14, 6, 5, 9},  {5, 14, 15, 15, 5, 9}};
}

TEST(CarryWatch, AHollowThatTheFilmClosesPullsOnWhatIsAroundIt) {
  CarryOptions options{.vacuum_share = 2.5};
  const CarryReport closed = judged(cup(0), options);
  EXPECT_NEAR(closed.cut->demand, (36 + 2.5 * 64) / 4, 1e-6);
  EXPECT_GE(closed.cut->moment.count(), 6U) << "one layer's dimple holds no vacuum";
  EXPECT_NEAR(judged(cup(2), options).cut->demand, 100.0 / 4, 1e-6) << "with a slot in its wall";
}

TEST(CarryWatch, AHollowStandsOnThePlatformAsInACup) {
  CarryOptions options{.vacuum_share = 2.5};
  const std::vector<Block> tube{{5, 5, 6, 15, 0, 9}, {14, 5, 15, 15, 0, 9}, {5, 5, 15, 6, 0, 9}, {5, 14, 15, 15, 0, 9}};
  EXPECT_NEAR(judged(tube, options).cut->demand, (36 + 2.5 * 64) / 36, 1e-6);
}

TEST(CarryWatch, ALargePieceIsPulledHarderWhereThePullGrowsWithSize) {
  const std::vector<Block> plate{{9, 9, 11, 11, 0, 3}, {5, 5, 15, 15, 3, 5}};
  // Area over perimeter of a square of 10 mm, its perimeter taken as of a disc.
  CarryOptions options{.doubled_at_mm = 100 / (40 * std::numbers::pi / 4)};
  EXPECT_NEAR(judged(plate, options).cut->demand, 2 * 100.0 / 4, 0.01);
}

TEST(CarryWatch, ALayerThatComesOffFasterIsPulledHarder) {
  const auto runs = test::runs_of({{9, 9, 11, 11, 0, 3}, {5, 5, 15, 15, 3, 5}});
  CarryWatch watch{{.pitch_mm = test::kBlockPitch, .thickness_mm = 0.5}};
  for (const LayerRuns& layer : runs) ASSERT_TRUE(watch.add(layer, layer, nullptr, &layer == &runs.back() ? 1.5 : 1));
  const auto report = watch.finish({});
  ASSERT_TRUE(report);
  EXPECT_NEAR(report->cut->demand, 1.5 * 100 / 4, 1e-6);
  EXPECT_EQ(report->cut->moment.count(), 4U);
}

TEST(CarryWatch, WhatHoldsLessThanTheLeastIsJudgedApart) {
  const std::vector<Block> blocks{{2, 2, 8, 18, 0, 12}, {13, 9, 13.5, 9.5, 0, 4}, {12, 8, 15, 11, 4, 8}};
  const CarryReport report = judged(blocks);
  EXPECT_NEAR(report.worst()->demand, 1, 1e-6);
  ASSERT_TRUE(report.small);
  EXPECT_GE(report.small->demand, 9 / 0.25 - 1e-9);
  EXPECT_NEAR(report.small->held_mm2, 9, 1e-9);
  CarryOptions options;
  options.least_held_mm2 = 9;
  EXPECT_NEAR(judged(blocks, options).cut->demand, 9 / 0.25, 1e-9);
}

TEST(CarryWatch, ListsEverySectionAboveTheLimitAndNoneBelow) {
  const std::vector<Block> blocks{{2, 2, 4, 4, 0, 4}, {12, 2, 14, 4, 0, 4}, {2, 12, 3, 13, 0, 4},
                                  {1, 1, 6, 6, 4, 6}, {11, 1, 15, 5, 4, 6}, {1, 11, 6, 16, 4, 6}};
  CarryOptions options;
  options.limit = 12;
  const CarryReport report = judged(blocks, options);
  ASSERT_FALSE(report.weak.empty());
  for (const CarryPlace& place : report.weak) EXPECT_GT(place.demand, 12);
  const auto at = [&](double x, double y) {
    return std::ranges::any_of(report.weak, [&](const CarryPlace& p) {
      return std::abs(p.place.x_mm - x) < 0.01 && std::abs(p.place.y_mm - y) < 0.01;
    });
  };
  EXPECT_TRUE(at(2.5, 12.5)) << "25 mm2 on 1";
  EXPECT_FALSE(at(13, 3)) << "16 mm2 on 4";
}

/// A column of 10 x 10 mm under a slab that reaches 4 mm beyond it, and a tip of 0.5 mm under its end. Tip and column
/// as one beam: 140 mm2 pulled 2 mm beside the middle, and the tip is farthest out.
std::vector<Block> slab_on_column_and_tip() {
  return {{2, 4, 12, 14, 0, 10}, {2, 4, 16, 14, 10, 12}, {15.4, 8.7, 15.9, 9.2, 0, 10}};
}

TEST(CarryWatch, ATipThatTearsBesideWhatCarriesAloneLosesNoPrint) {
  CarryOptions options;
  options.limit = 3.9;
  const CarryReport report = judged(slab_on_column_and_tip(), options);
  ASSERT_FALSE(report.weak.empty());
  for (const CarryPlace& place : report.weak) EXPECT_NEAR(place.place.x_mm, 15.65, 0.01);
  ASSERT_TRUE(report.without_weak);
  // The column alone: 1.4 in the mean, and 280 mm3 on a square of 10 mm.
  EXPECT_NEAR(report.without_weak->demand, 1.4 * (1 + 2 * 6 / 10.0), 1e-6);
  options.limit = 3;
  EXPECT_FALSE(judged(slab_on_column_and_tip(), options).without_weak) << "the column is too weak as well, and no tip";
  options.limit = 5;
  const CarryReport strong = judged(slab_on_column_and_tip(), options);
  EXPECT_TRUE(strong.weak.empty());
  EXPECT_FALSE(strong.without_weak) << "nothing tears";
}

TEST(CarryWatch, ASectionThatOneWouldSeeMayNotTear) {
  CarryOptions options;
  options.limit = 3.9;
  options.most_torn_mm2 = 0.2;
  EXPECT_FALSE(judged(slab_on_column_and_tip(), options).without_weak) << "0.25 mm2";
}

TEST(CarryWatch, ATipThatAloneHeldAPieceUntilItMetTheRestMayTearAfterwardsOnly) {
  CarryOptions options;
  options.limit = 3.9;
  auto blocks = slab_on_column_and_tip();
  blocks.back().behind = 6;
  blocks.push_back({15.2, 8.5, 16, 9.4, 6, 12});  // an island until the slab meets it
  EXPECT_TRUE(judged(blocks, options).without_weak);
  blocks.push_back({14, 4, 16, 14, 6, 12});  // 20 mm2 on the tip, too much from the first layer on
  EXPECT_FALSE(judged(blocks, options).without_weak) << "it would float";
}

TEST(CarryWatch, TipsThatTearOneAfterTheOtherLoseThePrint) {
  auto blocks = four_tips(4);
  blocks.push_back({6, 6, 18, 14, 4, 8});
  CarryOptions options;
  options.limit = 36;
  const CarryReport report = judged(blocks, options);
  EXPECT_EQ(report.weak.size(), 2U) << "the near ones";
  EXPECT_FALSE(report.without_weak);
}

TEST(CarryWatch, APushSidewaysBendsByTheHeightAboveTheSection) {
  // A tower of 4 x 4 mm, 10 mm high: the lowest section is bent by the share of the pull times 9.5 mm.
  CarryOptions options;
  options.sideways_share = 0.5;
  const CarryReport report = judged({{8, 8, 12, 12, 0, 20}}, options);
  // A square bends most over its corner.
  EXPECT_NEAR(report.bending->demand, 1 + std::sqrt(2) * 0.5 * 9.5 * 6 / 4, 1e-6);
  EXPECT_EQ(report.bending->layer.count(), 1U);
  EXPECT_NEAR(judged({{8, 8, 12, 12, 0, 20}}).bending->demand, 1, 1e-9);
}

TEST(CarryWatch, WhatItsOwnExposureDoesNotCureIsNotPulled) {
  const auto runs = test::runs_of({{4, 4, 6, 6, 0, 2}, {4, 4, 16, 16, 2, 3}});
  CarryOptions options{.pitch_mm = 0.1, .thickness_mm = 0.5};
  for (const bool lit : {true, false}) {
    CarryWatch watch{options};
    for (const LayerRuns& layer : runs) {
      const LayerLight light{layer,
                             lit || &layer != &runs.back() ? layer : LayerRuns::from_contours({}, layer.size(), 0.1)};
      ASSERT_TRUE(watch.add(layer, layer, &light));
    }
    const auto report = watch.finish({});
    ASSERT_TRUE(report);
    EXPECT_EQ(report->cut.has_value(), lit);
    if (lit) {
      EXPECT_NEAR(report->cut->demand, 36, 1e-9);
    }
  }
}

TEST(CarryWatch, CountsOfRimsThatOtherLightCuredNothingAndOfTheInsideAll) {
  // Rows of pixels as a mask has them: dark, dim, white twice, dim, dark; solid all but the outer ones, three rows
  // high.
  const PixelSize size{6, 5};
  Mask mask{size, std::vector<std::uint8_t>(30)};
  for (std::size_t y = 1; y < 4; ++y)
    for (const auto& [x, grey] : {std::pair{1, 90}, {2, 255}, {3, 255}, {4, 90}})
      mask.rows[y * 6 + static_cast<std::size_t>(x)] = static_cast<std::uint8_t>(grey);
  const LayerRuns solid = LayerRuns::from_mask(mask.view(), 1);
  EXPECT_EQ(firm_pixels(mask.view(), solid), LayerRuns::from_mask(mask.view(), 128));
  // Dark as a whole, as over a void: what has only solid pixels around it.
  const Mask dark{size, std::vector<std::uint8_t>(30)};
  Mask inside = dark;
  inside.rows[2 * 6 + 2] = inside.rows[2 * 6 + 3] = 255;
  EXPECT_EQ(firm_pixels(dark.view(), solid), LayerRuns::from_mask(inside.view(), 255));
}

TEST(CarryWatch, MeasuresByFirmPixelsAndByAllWhereNoneAreFirm) {
  const auto solid = test::runs_of({{9, 9, 11, 11, 0, 2}, {8, 8, 12, 12, 2, 3}});
  const auto firm = test::runs_of({{9.5, 9.5, 10.5, 10.5, 0, 2}, {8, 8, 12, 12, 2, 3}});
  for (const bool some : {true, false}) {
    CarryWatch watch{{.pitch_mm = 0.1, .thickness_mm = 0.5}};
    for (std::size_t k = 0; k < solid.size(); ++k)
      ASSERT_TRUE(watch.add(solid[k], some ? firm[k] : LayerRuns::from_contours({}, solid[k].size(), 0.1)));
    const auto report = watch.finish({});
    ASSERT_TRUE(report);
    EXPECT_NEAR(report->cut->demand, some ? 16 : 4, 1e-9);
  }
}

TEST(CarryWatch, RefusesLayersOfAnotherSize) {
  CarryWatch watch{{.pitch_mm = 0.1, .thickness_mm = 0.5}};
  const auto empty = [](PixelSize size) { return LayerRuns::from_contours({}, size, 0.1); };
  ASSERT_TRUE(watch.add(empty({20, 20}), empty({20, 20})));
  EXPECT_EQ(watch.add(empty({20, 21}), empty({20, 21})).error().code, ErrorCode::InvalidInput);
  EXPECT_EQ(watch.add(empty({20, 20}), empty({20, 21})).error().code, ErrorCode::InvalidInput);
}

TEST(CarryWatch, FindsTheSameOnOneThreadAndOnMany) {
  auto blocks = four_tips(60);
  for (std::uint32_t i = 0; i < 20; ++i) blocks.push_back({4 + 0.2 * i, 6, 16, 14 + 0.1 * i, 60 + i, 61 + i});
  const CarryReport many = judged(blocks);
  const tbb::global_control one{tbb::global_control::max_allowed_parallelism, 1};
  EXPECT_EQ(to_json(judged(blocks)), to_json(many));
}

}  // namespace
}  // namespace telefab::fab
