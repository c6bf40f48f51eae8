// SPDX-License-Identifier: GPL-3.0-or-later
#include <gtest/gtest.h>

#include <random>
#include <telefab/fab/verify/support_check.hpp>

namespace telefab::fab {
namespace {

/// Rows from the back to the front, '#' solid.
LayerRuns drawn(const std::vector<std::string>& rows) {
  Mask mask;
  mask.size = {static_cast<std::uint32_t>(rows[0].size()), static_cast<std::uint32_t>(rows.size())};
  for (const auto& row : rows)
    for (const char c : row) mask.rows.push_back(c == '#' ? 255 : 0);
  return LayerRuns::from_mask(mask.view(), 128);
}

SupportReport watched(const std::vector<std::vector<std::string>>& layers) {
  MaskWatch watch{0.1, 4};
  for (const auto& layer : layers) EXPECT_TRUE(watch.add(drawn(layer)));
  return watch.finish();
}

const std::vector<std::string> kPost{"........", ".##.....", ".##.....", "........", "........"};
const std::vector<std::string> kPostAndIsland{"........", ".##..##.", ".##..##.", "........", "........"};
const std::vector<std::string> kPostAndSpeck{"........", ".##..#..", ".##.....", "........", "........"};

TEST(MaskWatch, PassesAPost) { EXPECT_TRUE(watched({kPost, kPost, kPost}).passes()); }

TEST(MaskWatch, FindsAnIslandWhereItBegins) {
  const auto report = watched({kPost, kPost, kPostAndIsland, kPostAndIsland});
  ASSERT_EQ(report.count(Finding::Kind::Island), 1U);
  EXPECT_EQ(report.findings[0].layer, LayerIndex{2});
  EXPECT_NEAR(report.findings[0].place.x_mm, 0.55, 1e-9);
  EXPECT_NEAR(report.findings[0].size_mm2, 0.04, 1e-9);
  EXPECT_FALSE(report.passes());
}

TEST(MaskWatch, IsNotFooledByAnIslandThatGrowsFromASpeck) {
  EXPECT_EQ(watched({kPost, kPostAndSpeck, kPostAndIsland}).count(Finding::Kind::Island), 1U);
  EXPECT_TRUE(watched({kPost, kPostAndSpeck, kPost}).passes());
}

TEST(MaskWatch, TakesForOneBodyWhatIsSolidAtTheTopOfTheLayer) {
  const std::vector<std::string> bridged{"........", ".######.", ".##..##.", "........", "........"};
  const auto looked = [&](const std::vector<std::string>& joined) {
    MaskWatch watch{0.1, 4};
    const LayerLight light{drawn(joined), drawn(kPostAndIsland)};
    EXPECT_TRUE(watch.add(drawn(kPost)));
    EXPECT_TRUE(watch.add(drawn(kPostAndIsland), nullptr, &light));
    EXPECT_TRUE(watch.add(drawn(kPostAndIsland)));
    return watch.finish().count(Finding::Kind::Island);
  };
  EXPECT_EQ(looked(bridged), 0U);
  EXPECT_EQ(looked(kPostAndIsland), 1U);
}

TEST(MaskWatch, CountsOnlyWhatIsSolidToTheMiddleAsAnIsland) {
  const std::vector<std::string> halo{"....####", ".##.####", ".##.####", "........", "........"};
  MaskWatch watch{0.1, 4};
  const LayerLight light{drawn(halo), drawn(halo)};
  EXPECT_TRUE(watch.add(drawn(kPost)));
  EXPECT_TRUE(watch.add(drawn(kPostAndSpeck), nullptr, &light));
  EXPECT_TRUE(watch.finish().passes());
}

TEST(MaskWatch, LetsHangWhatLaterLayersCureButNothingStandOnIt) {
  // Two layers dark over a void, then a lit one: it floats, and not what hangs below.
  const LayerLight dark{drawn(kPostAndIsland), drawn(kPost)}, lit{drawn(kPostAndIsland), drawn(kPostAndIsland)};
  MaskWatch watch{0.1, 4};
  EXPECT_TRUE(watch.add(drawn(kPost), nullptr, &dark));
  EXPECT_TRUE(watch.add(drawn(kPostAndIsland), nullptr, &dark));
  EXPECT_TRUE(watch.add(drawn(kPostAndIsland), nullptr, &dark));
  EXPECT_TRUE(watch.add(drawn(kPostAndIsland), nullptr, &lit));
  const auto report = watch.finish();
  ASSERT_EQ(report.count(Finding::Kind::Island), 1U);
  EXPECT_EQ(report.findings[0].layer, LayerIndex{3});
}

TEST(MaskWatch, TellsWhichPixelsWouldBeSmallIslandsAndAddsNothing) {
  MaskWatch watch{0.1, 4};
  EXPECT_EQ(watch.specks(drawn(kPostAndIsland), nullptr, 100).count(), 0U);  // the platform holds all
  EXPECT_TRUE(watch.add(drawn(kPost)));
  const LayerRuns specks = watch.specks(drawn(kPostAndIsland), nullptr, 4);
  EXPECT_EQ(specks, drawn({"........", ".....##.", ".....##.", "........", "........"}));
  EXPECT_TRUE(specks.contains(5, 2));
  EXPECT_FALSE(specks.contains(1, 2));
  EXPECT_FALSE(specks.contains(4, 2));
  EXPECT_EQ(watch.specks(drawn(kPostAndIsland), nullptr, 3).count(), 0U);
  EXPECT_EQ(watch.specks(drawn(kPostAndSpeck), nullptr, 4).count(), 0U);  // below what add() reports
  EXPECT_TRUE(watch.finish().passes());
}

TEST(MaskWatch, ReportsAClosedHollowAsATrapAndAnInvertedCupAsACup) {
  const std::vector<std::string> full{"......", ".####.", ".####.", ".####.", ".####.", "......"};
  const std::vector<std::string> ring{"......", ".####.", ".#..#.", ".#..#.", ".####.", "......"};
  const std::vector<std::string> side{"......", ".####.", ".#....", ".#..#.", ".####.", "......"};
  EXPECT_EQ(watched({full, ring, ring, full}).count(Finding::Kind::ResinTrap), 1U);
  EXPECT_EQ(watched({full, ring, ring}).count(Finding::Kind::SuctionCup), 1U);
  EXPECT_EQ(watched({full, ring, ring, side, full}).count(Finding::Kind::SuctionCup), 1U);
  EXPECT_EQ(watched({full, ring, ring, side, full}).count(Finding::Kind::ResinTrap), 0U);
  const auto vented = watched({full, side, ring, ring, full});
  EXPECT_TRUE(vented.findings.empty());
}

TEST(MaskWatch, CallsASupportTrappedOnlyWhereTheHollowIsNotOpenToThePlatform) {
  const std::vector<std::string> full{"......", ".####.", ".####.", ".####.", ".####.", "......"};
  const std::vector<std::string> ring{"......", ".####.", ".#..#.", ".#..#.", ".####.", "......"};
  const std::vector<std::string> pin{"......", "......", "..#...", "......", "......", "......"};
  const auto trapped = [&](const std::vector<std::vector<std::string>>& layers) {
    MaskWatch watch{0.1, 3};
    const LayerRuns supports = drawn(pin);
    for (const auto& layer : layers) EXPECT_TRUE(watch.add(drawn(layer), &supports));
    return watch.finish().count(Finding::Kind::TrappedSupport);
  };
  EXPECT_EQ(trapped({full, ring, ring, full}), 1U);
  EXPECT_EQ(trapped({ring, ring, full}), 0U);
}

TEST(MaskWatch, RefusesMasksOfDifferentSizes) {
  MaskWatch watch{0.1, 4};
  EXPECT_TRUE(watch.add(drawn({"##", "##"})));
  EXPECT_FALSE(watch.add(drawn({"##"})));
}

TEST(LayerRuns, AgreesWithAPixelFloodFillOnNoise) {
  std::mt19937 rng{7};
  int components = 0;
  for (int round = 0; round < 40; ++round) {
    std::vector<std::string> rows(12, std::string(17, '.'));
    for (auto& row : rows)
      for (char& c : row) c = rng() % 5 < 2 ? '#' : '.';
    const LayerRuns runs = drawn(rows);
    for (const bool diagonal : {false, true}) {
      auto left = rows;
      int found = 0;
      for (int y = 0; y < 12; ++y)
        for (int x = 0; x < 17; ++x) {
          if (left[y][x] != '#') continue;
          ++found;
          std::vector<std::pair<int, int>> open{{x, y}};
          left[y][x] = '.';
          while (!open.empty()) {
            const auto [px, py] = open.back();
            open.pop_back();
            for (int dy = -1; dy <= 1; ++dy)
              for (int dx = -1; dx <= 1; ++dx) {
                if (!diagonal && dx != 0 && dy != 0) continue;
                const int qx = px + dx, qy = py + dy;
                if (qx < 0 || qy < 0 || qx >= 17 || qy >= 12 || left[qy][qx] != '#') continue;
                left[qy][qx] = '.';
                open.emplace_back(qx, qy);
              }
          }
        }
      EXPECT_EQ(components_of(runs, diagonal).components.size(), static_cast<std::size_t>(found));
      components += found;
    }
    EXPECT_EQ(runs.complement().complement(), runs);
  }
  EXPECT_GT(components, 500);
}

TEST(LayerRuns, PutsContoursOnTheSamePixelsAsTheirCentres) {
  const auto outer = Contour::from_vertices({{0.1, 0.1}, {1.0, 0.1}, {1.0, 0.9}, {0.1, 0.9}}).value();
  const auto hole = Contour::from_vertices({{0.3, 0.3}, {0.3, 0.5}, {0.6, 0.5}, {0.6, 0.3}}).value();
  const LayerRuns runs = LayerRuns::from_contours(std::vector{outer, hole}, {12, 10}, 0.1);
  EXPECT_TRUE(runs.row(0).empty());
  ASSERT_EQ(runs.row(1).size(), 1U);
  EXPECT_EQ(runs.row(1)[0], (PixelRun{1, 10}));
  ASSERT_EQ(runs.row(3).size(), 2U);
  EXPECT_EQ(runs.row(3)[0], (PixelRun{1, 3}));
  EXPECT_EQ(runs.row(3)[1], (PixelRun{6, 10}));
}

TEST(CureLevel, FollowsTheDoseOfTheProfile) {
  MachineProfile m;
  m.projection.irradiance_mw_per_cm2 = 10;
  m.layers.exposure_s = 2;
  m.layers.thickness_mm = 0.1;
  m.resin = {"r", 10, 1e9};  // no absorption: half of the dose cures
  EXPECT_EQ(cure_level(m), 128);
  m.resin.critical_dose_mj_per_cm2 = 1e4;
  EXPECT_EQ(cure_level(m), 255);
}

}  // namespace
}  // namespace telefab::fab
