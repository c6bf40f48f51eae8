// SPDX-License-Identifier: GPL-3.0-or-later
#include <gtest/gtest.h>

#include <cmath>
#include <numbers>
#include <random>
#include <telefab/fab/region/region.hpp>

// Every operation against a raster of sample points that lie off the grid lines of the shapes.
namespace telefab::fab {
namespace {

constexpr int kSide = 64;
constexpr double kStep = 0.25;

Point2 sample(int column, int row) { return {(column + 0.37) * kStep, (row + 0.41) * kStep}; }

/// Rings of the nasty kind: stars that cross themselves, very thin rings, boxes that share edges and corners.
std::vector<GridRing> nasty_rings(std::mt19937_64& rng) {
  const auto in = [&](double from, double to) { return std::uniform_real_distribution<double>{from, to}(rng); };
  const auto cell = [&] { return std::floor(in(0, 15)); };
  std::vector<GridRing> rings;
  for (int shape = 0; shape < 6; ++shape) {
    GridRing ring;
    switch (shape % 3) {
      case 0: {
        const int n = 5 + static_cast<int>(in(0, 20));
        const Point2 c{in(3, 13), in(3, 13)};
        for (int i = 0; i < n; ++i) {
          const double a = 2 * std::numbers::pi * i * (shape == 0 ? 2 : 1) / n, r = in(0.2, 5);
          ring.push_back(to_grid({c.x_mm + r * std::cos(a), c.y_mm + r * std::sin(a)}));
        }
        break;
      }
      case 1: {
        const double x = cell(), y = cell(), w = 1 + std::floor(in(0, 4)), h = 1 + std::floor(in(0, 4));
        ring = {to_grid({x, y}), to_grid({x + w, y}), to_grid({x + w, y + h}), to_grid({x, y + h})};
        break;
      }
      default: {
        const double x = in(0, 15), y = in(0, 15);
        ring = {to_grid({x, y}), to_grid({x + in(1, 6), y + 1e-6}), to_grid({x + in(1, 6), y + in(0, 0.01)})};
      }
    }
    rings.push_back(ring);
  }
  return rings;
}

/// Winding number without the library: crossings of a ray to the right.
int winding(std::span<const GridRing> rings, Point2 p) {
  int turns = 0;
  for (const GridRing& ring : rings)
    for (std::size_t i = 0; i < ring.size(); ++i) {
      const Point2 a = to_mm(ring[i]), b = to_mm(ring[(i + 1) % ring.size()]);
      if ((a.y_mm <= p.y_mm) == (b.y_mm <= p.y_mm)) continue;
      const double x = a.x_mm + (p.y_mm - a.y_mm) / (b.y_mm - a.y_mm) * (b.x_mm - a.x_mm);
      if (x > p.x_mm) turns += b.y_mm > a.y_mm ? 1 : -1;
    }
  return turns;
}

double distance_to(std::span<const GridRing> rings, Point2 p) {
  double best = 1e9;
  for (const GridRing& ring : rings)
    for (std::size_t i = 0; i < ring.size(); ++i) {
      const Point2 a = to_mm(ring[i]), b = to_mm(ring[(i + 1) % ring.size()]);
      const double vx = b.x_mm - a.x_mm, vy = b.y_mm - a.y_mm, wx = p.x_mm - a.x_mm, wy = p.y_mm - a.y_mm;
      const double l = vx * vx + vy * vy, t = l > 0 ? std::clamp((wx * vx + wy * vy) / l, 0.0, 1.0) : 0.0;
      best = std::min(best, std::hypot(wx - t * vx, wy - t * vy));
    }
  return best;
}

class RegionRaster : public testing::TestWithParam<std::uint64_t> {};

TEST_P(RegionRaster, BooleansAgreeWithPointwiseLogic) {
  std::mt19937_64 rng{GetParam()};
  const auto rings_a = nasty_rings(rng), rings_b = nasty_rings(rng);
  const Region a = Region::from_rings(rings_a).value(), b = Region::from_rings(rings_b).value();
  const Region both = intersect(a, b), either = unite(a, b), rest = subtract(a, b);
  int inside = 0;
  for (int row = 0; row < kSide; ++row)
    for (int column = 0; column < kSide; ++column) {
      const Point2 p = sample(column, row);
      if (distance_to(rings_a, p) < 1e-4 || distance_to(rings_b, p) < 1e-4) continue;
      const bool in_a = winding(rings_a, p) > 0, in_b = winding(rings_b, p) > 0;
      inside += in_a;
      EXPECT_EQ(a.contains(p), in_a);
      EXPECT_EQ(both.contains(p), in_a && in_b);
      EXPECT_EQ(either.contains(p), in_a || in_b);
      EXPECT_EQ(rest.contains(p), in_a && !in_b);
    }
  EXPECT_GT(inside, 20);
  EXPECT_NEAR(either.area_mm2() + both.area_mm2(), a.area_mm2() + b.area_mm2(), 1e-3);
}

TEST_P(RegionRaster, OffsetHoldsExactlyThePointsWithinTheDistance) {
  std::mt19937_64 rng{GetParam()};
  const Region a = Region::from_rings(nasty_rings(rng)).value();
  const Region grown = offset(a, Millimetres{0.5}, Millimetres{1e-4});
  const Region shrunk = offset(a, Millimetres{-0.3}, Millimetres{1e-4});
  int grown_only = 0;
  for (int row = 0; row < kSide; ++row)
    for (int column = 0; column < kSide; ++column) {
      const Point2 p = sample(column, row);
      const bool in = a.contains(p);
      const double d = distance_to(a.rings(), p);
      if (std::abs(d - 0.5) > 1e-3) {
        EXPECT_EQ(grown.contains(p), in || d < 0.5);
      }
      if (std::abs(d - 0.3) > 1e-3) {
        EXPECT_EQ(shrunk.contains(p), in && d > 0.3);
      }
      grown_only += !in && d < 0.49;
    }
  EXPECT_GT(grown_only, 5);
}

INSTANTIATE_TEST_SUITE_P(Seeds, RegionRaster, testing::Range<std::uint64_t>(0, 24));

TEST(RegionRaster, HoldsThousandsOfRingsThatTouch) {
  std::vector<GridRing> rings;
  for (int row = 0; row < 60; ++row)
    for (int column = 0; column < 60; ++column)
      if ((row + column) % 2 == 0) {  // a chessboard: all fields touch at corners
        const double x = column, y = row;
        rings.push_back({to_grid({x, y}), to_grid({x + 1, y}), to_grid({x + 1, y + 1}), to_grid({x, y + 1})});
      }
  const Region board = Region::from_rings(rings).value();
  EXPECT_NEAR(board.area_mm2(), 1800, 1e-6);
  const Region whole = Region::from_rings(std::vector<GridRing>{
                                              {to_grid({0, 0}), to_grid({60, 0}), to_grid({60, 60}), to_grid({0, 60})}})
                           .value();
  EXPECT_NEAR(subtract(whole, board).area_mm2(), 1800, 1e-6);
  // The middle of an empty field lies half a side from its neighbours: inside, nothing is left open.
  const Region inner = offset(whole, Millimetres{-1}, Millimetres{1e-3});
  EXPECT_NEAR(intersect(offset(board, Millimetres{0.6}, Millimetres{1e-3}), inner).area_mm2(), 58.0 * 58.0, 1e-6);
  EXPECT_LT(intersect(offset(board, Millimetres{0.4}, Millimetres{1e-3}), inner).area_mm2(), 58.0 * 58.0 - 50);
}

}  // namespace
}  // namespace telefab::fab
