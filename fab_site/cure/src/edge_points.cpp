// SPDX-License-Identifier: GPL-3.0-or-later
#include <tbb/parallel_for.h>

#include <algorithm>
#include <cmath>
#include <telefab/fab/cure/edge_points.hpp>

#include "tile_sampler.hpp"

namespace telefab::fab {
namespace {

/// A crossing known to lie on a line between two points: ln(dose) there is nearly straight, two Newton steps do.
EdgePoint refined(const DoseField& dose, double threshold, PixelPlace from, double step_px, double at, bool along_y) {
  const double level = std::log(threshold);
  double share = at;
  DoseField::Sample sample;
  PixelPlace place = from;
  for (int round = 0; round < 3; ++round) {
    place = along_y ? PixelPlace{from.x_px, from.y_px + share * step_px}
                    : PixelPlace{from.x_px + share * step_px, from.y_px};
    sample = dose.sample(place);
    const double slope = (along_y ? sample.slope_y : sample.slope_x) / sample.dose * step_px;
    const double off = std::log(sample.dose) - level;
    if (round == 2 || std::abs(off) < 1e-6 || slope == 0) break;
    share = std::clamp(share - off / slope, 0.0, 1.0);
  }
  const double length = std::hypot(sample.slope_x, sample.slope_y);
  EdgePoint point{place, 0, 0, length / sample.dose, along_y};
  if (length > 0) {
    point.normal_x = -sample.slope_x / length;
    point.normal_y = -sample.slope_y / length;
  }
  return point;
}

}  // namespace

std::vector<EdgePoint> edge_points(const DoseField& dose, double threshold, int sub_pixels, int lines_per_px) {
  const int sub = std::clamp(sub_pixels, 1, 16), lines = std::clamp(lines_per_px, 1, 16);
  const TileRange range = tiles_of(dose.box());
  const LineSampler sampler{dose.kernel(), sub, lines};
  const auto level = static_cast<float>(threshold);
  const double step_px = 1.0 / sub;
  std::vector<std::vector<EdgePoint>> rows(static_cast<std::size_t>(range.rows));
  tbb::parallel_for(0, range.rows, [&](int r) {
    std::vector<EdgePoint>& found = rows[static_cast<std::size_t>(r)];
    const auto bounds = bounds_of_row(dose, range, r);
    std::vector<float> doses(sampler.lines() * sampler.points());
    for (int c = 0; c < range.columns; ++c) {
      const TileBounds& b = bounds[static_cast<std::size_t>(c)];
      if (b.most < level || b.least > level * 1.00001F) continue;
      const double x0 = range.x + c * kTileSide, y0 = range.y + r * kTileSide;
      for (const bool along_y : {false, true}) {
        sampler.sample(dose, static_cast<int>(x0), static_cast<int>(y0), along_y, doses);
        for (std::size_t line = 0; line < sampler.lines(); ++line) {
          const float* d = doses.data() + line * sampler.points();
          const double across = (static_cast<double>(line) + 0.5) / lines;
          for (std::size_t i = 0; i + 1 < sampler.points(); ++i) {
            if ((d[i] < level) == (d[i + 1] < level)) continue;
            const double low = std::log(std::max(1e-30F, d[i])), high = std::log(std::max(1e-30F, d[i + 1]));
            const double at = std::clamp((std::log(threshold) - low) / (high - low), 0.0, 1.0);
            const double along = static_cast<double>(i) * step_px;
            const PixelPlace from = along_y ? PixelPlace{x0 + across, y0 + along} : PixelPlace{x0 + along, y0 + across};
            found.push_back(refined(dose, threshold, from, step_px, at, along_y));
          }
        }
      }
    }
  });
  std::vector<EdgePoint> points;
  for (const auto& row : rows) points.insert(points.end(), row.begin(), row.end());
  return points;
}

}  // namespace telefab::fab
