// SPDX-License-Identifier: GPL-3.0-or-later
#include "region_difference.hpp"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <cmath>

#include "tile_sampler.hpp"

namespace telefab::fab {
namespace {

/// A sub-pixel cured or missing farther than this from every contour is an island or a void.
constexpr double kFar_px = 1;

struct Sums {
  std::uint64_t target = 0, cured = 0, excess = 0, missing = 0, far = 0;
};

PixelBox united_box(const PixelBox& a, const PixelBox& b) {
  if (a.empty()) return b;
  if (b.empty()) return a;
  const int x = std::min(a.x, b.x), y = std::min(a.y, b.y);
  return {x, y, std::max(a.x + a.width, b.x + b.width) - x, std::max(a.y + a.height, b.y + b.height) - y};
}

}  // namespace

void add_difference(const DoseField& dose, double threshold, const RingIndex& target, int sub_pixels,
                    EdgeFigures& figures) {
  const TileRange range = tiles_of(united_box(dose.box(), target.box()));
  const TileSampler sampler{dose.kernel(), sub_pixels, 0.5};
  const auto level = static_cast<float>(threshold);
  const std::size_t side = sampler.points(), columns = static_cast<std::size_t>(range.columns) * side;
  std::vector<Sums> rows(static_cast<std::size_t>(range.rows));
  tbb::parallel_for(0, range.rows, [&](int r) {
    Sums& sums = rows[static_cast<std::size_t>(r)];
    const int y0 = range.y + r * kTileSide;
    // The target of this row of tiles, sub-pixel by sub-pixel.
    std::vector<std::uint8_t> inside(side * columns, 0);
    for (std::size_t line = 0; line < side; ++line) {
      const auto spans = target.spans_at(y0 + (static_cast<double>(line) + 0.5) / sub_pixels);
      for (std::size_t i = 0; i + 1 < spans.size(); i += 2) {
        const auto column = [&](double x) {
          return static_cast<std::ptrdiff_t>(
              std::clamp(std::ceil((x - range.x) * sub_pixels - 0.5), 0.0, static_cast<double>(columns)));
        };
        const auto row = inside.begin() + static_cast<std::ptrdiff_t>(line * columns);
        std::fill(row + column(spans[i]), row + std::max(column(spans[i]), column(spans[i + 1])), std::uint8_t{1});
      }
    }
    const auto bounds = bounds_of_row(dose, range, r);
    std::vector<float> doses(side * side);
    for (int c = 0; c < range.columns; ++c) {
      const TileBounds& b = bounds[static_cast<std::size_t>(c)];
      const bool none = b.most<level, all = b.least> level * 1.00001F;
      std::uint32_t wanted_count = 0;
      for (std::size_t line = 0; line < side; ++line) {
        const std::uint8_t* in = inside.data() + line * columns + static_cast<std::size_t>(c) * side;
        for (std::size_t i = 0; i < side; ++i) wanted_count += in[i];
      }
      if (none && wanted_count == 0) continue;
      if (all && wanted_count == side * side) {
        sums.target += wanted_count;
        sums.cured += wanted_count;
        continue;
      }
      if (!none && !all) sampler.sample(dose, range.x + c * kTileSide, y0, doses);
      for (std::size_t line = 0; line < side; ++line) {
        const std::uint8_t* in = inside.data() + line * columns + static_cast<std::size_t>(c) * side;
        for (std::size_t i = 0; i < side; ++i) {
          const bool cured = all || (!none && doses[line * side + i] >= level), wanted = in[i] != 0;
          sums.target += wanted;
          sums.cured += cured;
          if (cured == wanted) continue;
          ++(cured ? sums.excess : sums.missing);
          const PixelPlace place{range.x + c * kTileSide + (static_cast<double>(i) + 0.5) / sub_pixels,
                                 y0 + (static_cast<double>(line) + 0.5) / sub_pixels};
          sums.far += target.distance(place, kFar_px) >= kFar_px;
        }
      }
    }
  });
  const double px2 = 1.0 / (sub_pixels * sub_pixels);
  for (const Sums& sums : rows) {
    figures.target_px2 += static_cast<double>(sums.target) * px2;
    figures.cured_px2 += static_cast<double>(sums.cured) * px2;
    figures.excess_px2 += static_cast<double>(sums.excess) * px2;
    figures.missing_px2 += static_cast<double>(sums.missing) * px2;
    figures.far_px2 += static_cast<double>(sums.far) * px2;
  }
}

}  // namespace telefab::fab
