// SPDX-License-Identifier: GPL-3.0-or-later
#include "edge_samples.hpp"

#include <algorithm>
#include <cmath>

namespace telefab::fab {
namespace {

struct Way {
  std::vector<double> at;       ///< length of ring up to each vertex, and of the whole ring
  std::vector<double> corners;  ///< where the corners lie, rising, with the last before and the first after the ring
};

Way way_of(std::span<const Point2> v, double pitch_mm, double corner_rad) {
  Way way;
  double length = 0;
  for (std::size_t i = 0; i < v.size(); ++i) {
    const Point2 a = v[i], b = v[(i + 1) % v.size()];
    way.at.push_back(length);
    length += distance_mm(a, b) / pitch_mm;
  }
  way.at.push_back(length);
  const double least_cosine = std::cos(corner_rad);
  for (std::size_t i = 0; i < v.size(); ++i) {
    const Point2 a = v[(i + v.size() - 1) % v.size()], b = v[i], c = v[(i + 1) % v.size()];
    const double ux = b.x_mm - a.x_mm, uy = b.y_mm - a.y_mm, wx = c.x_mm - b.x_mm, wy = c.y_mm - b.y_mm;
    if (ux * wx + uy * wy < least_cosine * std::hypot(ux, uy) * std::hypot(wx, wy)) way.corners.push_back(way.at[i]);
  }
  if (!way.corners.empty()) {
    const double first = way.corners.front(), last = way.corners.back();
    way.corners.insert(way.corners.begin(), last - length);
    way.corners.push_back(first + length);
  }
  return way;
}

}  // namespace

std::vector<EdgeSpot> edge_spots(std::span<const Contour> rings, double pixel_pitch_mm, const EdgeSampling& sampling) {
  std::vector<EdgeSpot> spots;
  for (const Contour& ring : rings) {
    const auto v = ring.vertices();
    const Way way = way_of(v, pixel_pitch_mm, sampling.corner_rad);
    const double length = way.at.back();
    const double count = std::max(4.0, std::ceil(length / sampling.step_px));
    const double step = length / count;
    std::size_t edge = 0, corner = 0;
    for (double k = 0; k < count; ++k) {
      const double along = (k + 0.5) * step;
      while (edge + 2 < way.at.size() && way.at[edge + 1] <= along) ++edge;
      const double edge_length = way.at[edge + 1] - way.at[edge];
      const double share = edge_length > 0 ? (along - way.at[edge]) / edge_length : 0;
      const Point2 a = v[edge], b = v[(edge + 1) % v.size()];
      double weight = step;
      if (!way.corners.empty()) {
        while (corner + 2 < way.corners.size() && way.corners[corner + 1] <= along) ++corner;
        if (std::min(along - way.corners[corner], way.corners[corner + 1] - along) < sampling.corner_px)
          weight *= sampling.corner_weight;
      }
      spots.push_back({(a.x_mm + share * (b.x_mm - a.x_mm)) / pixel_pitch_mm,
                       (a.y_mm + share * (b.y_mm - a.y_mm)) / pixel_pitch_mm, static_cast<float>(weight)});
    }
  }
  return spots;
}

}  // namespace telefab::fab
