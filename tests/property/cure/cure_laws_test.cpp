// SPDX-License-Identifier: GPL-3.0-or-later
#include <gtest/gtest.h>

#include <random>

#include "lit_plates.hpp"

// What must hold for any masks, on seeded heaps of rectangles and grey noise.
namespace telefab::fab::test {
namespace {

class CureLaws : public testing::TestWithParam<std::uint64_t> {
 protected:
  static constexpr std::uint32_t kLayers = 6;
  /// Masks that leave a border of 16 pixels free.
  std::vector<Mask> masks() {
    std::mt19937_64 rng{GetParam()};
    const auto in = [&](int from, int to) { return from + static_cast<int>(rng() % static_cast<unsigned>(to - from)); };
    std::vector<Mask> all;
    for (std::uint32_t k = 0; k < kLayers; ++k) {
      const int x0 = in(16, 30), x1 = in(31, 48), y0 = in(16, 22), y1 = in(23, 32), seed = in(0, 1000);
      all.push_back(mask_of(model.mask, [=](int c, int r) {
        const bool inside = c >= x0 && c < x1 && r >= y0 && r < y1;
        return inside ? ((c * 31 + r * 17 + seed) % 5 == 0 ? (c * 37 + r * 101) % 256 : 255) : 0;
      }));
    }
    return all;
  }
  [[nodiscard]] CuredSolid cured(const std::vector<Mask>& shown, std::chrono::nanoseconds time, int threads = 0,
                                 std::vector<double>* volumes = nullptr) const {
    CureOptions options;
    options.threads = threads;
    const auto source = [&](LayerIndex i) -> Result<LitLayer> { return lit(shown[i.count()], time); };
    CuredSolid solid = cure_solid(model, kLayers, source, options, {}, {}).value();
    if (volumes)
      for (const auto& layer : solid.layers) volumes->push_back(layer.volume_mm3);
    return solid;
  }
  CureModel model = cure_model(plate_machine()).value();
};

TEST_P(CureLaws, MoreLightNeverCuresLess) {
  const auto shown = masks();
  DoseStream dim{model}, bright{model};
  int partial = 0;
  for (std::uint32_t k = kLayers; k-- > 0;) {
    const MaskExposure one{shown[k].view(), 1000ms}, other{shown[k].view(), 1030ms};
    const DepthMap a = DepthMap::of(dim.descend({&one, 1}).value(), model, 4);
    const DepthMap b = DepthMap::of(bright.descend({&other, 1}).value(), model, 4);
    for (const DepthMap::Tile& tile : a.tiles()) {
      const auto match = std::find_if(b.tiles().begin(), b.tiles().end(),
                                      [&](const auto& t) { return t.x == tile.x && t.y == tile.y; });
      ASSERT_NE(match, b.tiles().end());
      if (match->whole) continue;
      ASSERT_FALSE(tile.whole);
      const auto da = a.depths(tile), db = b.depths(*match);
      for (std::size_t i = 0; i < da.size(); ++i) {
        EXPECT_LE(da[i], db[i]);
        partial += da[i] > 0 && da[i] < DepthMap::kWhole;
      }
    }
  }
  EXPECT_GT(partial, 100);
}

TEST_P(CureLaws, AnyNumberOfThreadsMakesTheSameSolid) {
  const auto shown = masks();
  const CuredSolid one = cured(shown, 1s, 1);
  for (const int threads : {2, 7}) {
    const CuredSolid other = cured(shown, 1s, threads);
    EXPECT_EQ(one.digest, other.digest);
    EXPECT_EQ(one.volume_mm3, other.volume_mm3);
  }
}

TEST_P(CureLaws, ShiftedMasksMakeTheShiftedSolid) {
  const auto shown = masks();
  std::vector<Mask> moved;
  for (const Mask& mask : shown)
    moved.push_back(mask_of(model.mask, [&](int c, int r) {
      const int from_c = c - 3, from_r = r + 5;
      if (from_c < 0 || from_c >= 64 || from_r < 0 || from_r >= 48) return 0;
      return int{mask.rows[static_cast<std::size_t>(from_r * 64 + from_c)]};
    }));
  std::vector<double> here, there;
  (void)cured(shown, 1s, 0, &here);
  (void)cured(moved, 1s, 0, &there);
  ASSERT_EQ(here.size(), there.size());
  for (std::size_t i = 0; i < here.size(); ++i) EXPECT_NEAR(here[i], there[i], 1e-9);
  EXPECT_GT(here[0], 0.1);
}

TEST_P(CureLaws, WhatLiesAboveNeverCuresLessBelow) {
  auto shown = masks();
  const CuredSolid with = cured(shown, 1s);
  shown.back() = mask_of(model.mask, [](int, int) { return 0; });
  const CuredSolid without = cured(shown, 1s);
  for (std::size_t i = 0; i < with.layers.size(); ++i)
    EXPECT_GE(with.layers[i].volume_mm3, without.layers[i].volume_mm3);
  EXPECT_GT(with.layers.back().volume_mm3, without.layers.back().volume_mm3);
}

INSTANTIATE_TEST_SUITE_P(Seeds, CureLaws, testing::Range<std::uint64_t>(0, 8));

}  // namespace
}  // namespace telefab::fab::test
