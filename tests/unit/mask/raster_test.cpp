// SPDX-License-Identifier: GPL-3.0-or-later
#include <gtest/gtest.h>

#include <cmath>
#include <numbers>
#include <numeric>
#include <random>
#include <telefab/fab/mask/raster.hpp>

namespace telefab::fab {
namespace {

Contour ring(std::vector<Point2> vertices) { return Contour::from_vertices(std::move(vertices)).value(); }
Contour square(double x0, double y0, double x1, double y1) { return ring({{x0, y0}, {x1, y0}, {x1, y1}, {x0, y1}}); }
Contour turned_round(const Contour& c) { return ring({c.vertices().rbegin(), c.vertices().rend()}); }
std::uint8_t at(const Mask& m, std::uint32_t column, std::uint32_t row) {
  return m.rows[row * m.size.width_px + column];
}

const MaskFrame kFrame{{8, 6}, 1.0};

TEST(Rasterise, CoversWholePixelsFullyAndOthersNotAtAll) {
  const Mask mask = rasterise(std::vector{square(2, 1, 5, 3)}, kFrame);
  for (std::uint32_t row = 0; row < 6; ++row)
    for (std::uint32_t column = 0; column < 8; ++column)
      EXPECT_EQ(at(mask, column, row), column >= 2 && column < 5 && (row == 3 || row == 4) ? 255 : 0)
          << column << ' ' << row;
}

TEST(Rasterise, PutsTheBackOfThePlatformIntoTheFirstRow) {
  const Mask mask = rasterise(std::vector{square(0, 5, 1, 6)}, kFrame);
  EXPECT_EQ(at(mask, 0, 0), 255);
  EXPECT_EQ(std::accumulate(mask.rows.begin(), mask.rows.end(), 0), 255);
}

TEST(Rasterise, GivesThePartOfAPixelThatIsCovered) {
  const Mask mask = rasterise(std::vector{square(2.25, 1.5, 3, 2)}, kFrame);
  EXPECT_EQ(at(mask, 2, 4), std::lround(255 * 0.375));
  const Mask triangle = rasterise(std::vector{ring({{0, 0}, {1, 0}, {0, 1}})}, kFrame);
  EXPECT_EQ(at(triangle, 0, 5), 128);
}

TEST(Rasterise, LeavesHolesDarkAndFillsIslandsInThem) {
  const std::vector rings{square(0, 0, 8, 6), turned_round(square(1, 1, 7, 5)), square(3, 2, 5, 4)};
  const Mask mask = rasterise(rings, kFrame);
  EXPECT_EQ(at(mask, 0, 0), 255);
  EXPECT_EQ(at(mask, 2, 2), 0);
  EXPECT_EQ(at(mask, 4, 2), 255);
}

TEST(Rasterise, CutsOffWhatLiesOutsideOnEverySide) {
  const Mask mask = rasterise(std::vector{square(-100, -100, 100, 100)}, kFrame);
  EXPECT_TRUE(std::all_of(mask.rows.begin(), mask.rows.end(), [](std::uint8_t v) { return v == 255; }));
  const Mask none = rasterise(std::vector{square(20, 1, 30, 2), square(1, 20, 2, 30), square(-9, 1, -5, 2)}, kFrame);
  EXPECT_TRUE(std::all_of(none.rows.begin(), none.rows.end(), [](std::uint8_t v) { return v == 0; }));
  const Mask diamond = rasterise(std::vector{ring({{-2, 3}, {4, -3}, {10, 3}, {4, 9}})}, kFrame);
  EXPECT_EQ(at(diamond, 4, 3), 255);
  EXPECT_EQ(at(diamond, 0, 5), 128);  // its edge runs through the corner pixel
}

class RasteriseProperty : public testing::TestWithParam<std::uint64_t> {};

/// Stars with holes at any place; the reference looks at 32 x 32 points a pixel.
std::vector<Contour> random_star(std::mt19937_64& rng, double size) {
  const auto uniform = [&](double low, double high) {
    return low + (high - low) * static_cast<double>(rng() >> 11U) * 0x1p-53;
  };
  const Point2 centre{uniform(0.2, 0.8) * size, uniform(0.2, 0.8) * size};
  std::vector<Point2> outer;
  std::vector<Point2> hole;
  const int n = 5 + static_cast<int>(rng() % 30);
  for (int i = 0; i < n; ++i) {
    const double angle = 2 * std::numbers::pi * i / n;
    const double r = uniform(0.2, 0.5) * size;
    outer.push_back({centre.x_mm + r * std::cos(angle), centre.y_mm + r * std::sin(angle)});
    hole.push_back({centre.x_mm + 0.1 * size * std::cos(-angle), centre.y_mm + 0.1 * size * std::sin(-angle)});
  }
  return {ring(outer), ring(hole)};
}

TEST_P(RasteriseProperty, AgreesWithPointsCountedInEveryPixel) {
  std::mt19937_64 rng{GetParam()};
  constexpr int kSide = 24;
  constexpr int kFine = 32;
  const MaskFrame frame{{kSide, kSide}, 0.5};
  const auto rings = random_star(rng, kSide * 0.5);
  const Mask mask = rasterise(rings, frame);
  int grey_pixels = 0;
  for (std::uint32_t row = 0; row < kSide; ++row)
    for (std::uint32_t column = 0; column < kSide; ++column) {
      int inside = 0;
      for (int a = 0; a < kFine; ++a)
        for (int b = 0; b < kFine; ++b) {
          const Point2 p{(column + (a + 0.5) / kFine) * 0.5, (kSide - 1 - row + (b + 0.5) / kFine) * 0.5};
          inside += contains(rings[0], p) && !contains(rings[1], p);
        }
      const double share = static_cast<double>(inside) / (kFine * kFine);
      EXPECT_NEAR(at(mask, column, row) / 255.0, share, 0.06) << column << ' ' << row;
      grey_pixels += inside > 0 && inside < kFine * kFine;
    }
  EXPECT_GT(grey_pixels, 20);
}

TEST_P(RasteriseProperty, SumsUpToTheAreaOfTheRings) {
  std::mt19937_64 rng{GetParam()};
  const MaskFrame frame{{64, 64}, 0.5};
  std::vector<Contour> rings;
  for (const Contour& c : random_star(rng, 18)) {
    std::vector<Point2> moved;
    for (const Point2 p : c.vertices()) moved.push_back({p.x_mm + 7, p.y_mm + 7});
    rings.push_back(ring(std::move(moved)));
  }
  double area = 0;
  double length = 0;
  for (const Contour& c : rings) {
    area += c.signed_area_mm2();
    length += c.length_mm();
  }
  const Mask mask = rasterise(rings, frame);
  const double sum = std::accumulate(mask.rows.begin(), mask.rows.end(), 0.0) / 255 * 0.25;
  EXPECT_NEAR(sum, area, 0.25 * 0.5 / 255 * 4 * length / 0.5);  // half a level in every pixel on the boundary
}

TEST_P(RasteriseProperty, GivesOneFullMaskForTwoHalves) {
  std::mt19937_64 rng{GetParam()};
  const double x = 1 + static_cast<double>(rng() % 1000) / 200;
  Mask both = rasterise(std::vector{square(0, 0, x, 6)}, kFrame);
  add_cover(both, std::vector{square(x, 0, 8, 6)}, kFrame.pixel_pitch_mm);
  for (const std::uint8_t level : both.rows) EXPECT_GE(level, 254);
}
INSTANTIATE_TEST_SUITE_P(Seeds, RasteriseProperty, testing::Range<std::uint64_t>(0, 24));

}  // namespace
}  // namespace telefab::fab
