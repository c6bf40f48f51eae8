// SPDX-License-Identifier: GPL-3.0-or-later
#include "segment_map.hpp"

#include <algorithm>
#include <cmath>
#include <numeric>

namespace telefab::scan {

SegmentMap::SegmentMap(std::span<const Contour> rings) {
  Bounds2 box = Bounds2::nothing();
  double length = 0;
  for (std::uint32_t r = 0; r < rings.size(); ++r) {
    const auto v = rings[r].vertices();
    for (std::uint32_t i = 0; i < v.size(); ++i) {
      const Point2 a = v[i];
      const Point2 b = v[(i + 1) % v.size()];
      box.include(a);
      length += distance_mm(a, b);
      segments_.push_back({a, b, r, i});
    }
  }
  if (segments_.empty()) return;
  low_ = box.min;
  cell_ = std::max(2 * length / static_cast<double>(segments_.size()), 1e-9);
  const auto most = 4.0 * static_cast<double>(segments_.size()) + 1024;
  while ((box.width_mm() / cell_ + 1) * (box.depth_mm() / cell_ + 1) > most) cell_ *= 1.5;
  nx_ = static_cast<int>(box.width_mm() / cell_) + 1;
  ny_ = static_cast<int>(box.depth_mm() / cell_) + 1;
  start_.assign(static_cast<std::size_t>(nx_) * ny_ + 1, 0);
  const auto each_bucket = [&](const Segment& s, auto&& take) {
    const int x0 = column(std::min(s.a.x_mm, s.b.x_mm), low_.x_mm, nx_);
    const int x1 = column(std::max(s.a.x_mm, s.b.x_mm), low_.x_mm, nx_);
    const int y0 = column(std::min(s.a.y_mm, s.b.y_mm), low_.y_mm, ny_);
    const int y1 = column(std::max(s.a.y_mm, s.b.y_mm), low_.y_mm, ny_);
    for (int j = y0; j <= y1; ++j)
      for (int i = x0; i <= x1; ++i) take(static_cast<std::size_t>(j) * nx_ + i);
  };
  for (const Segment& s : segments_) each_bucket(s, [&](std::size_t b) { ++start_[b + 1]; });
  std::partial_sum(start_.begin(), start_.end(), start_.begin());
  entries_.resize(start_.back());
  std::vector<std::uint32_t> next(start_.begin(), start_.end() - 1);
  for (std::uint32_t k = 0; k < segments_.size(); ++k)
    each_bucket(segments_[k], [&](std::size_t b) { entries_[next[b]++] = k; });
}

bool SegmentMap::passes(Point2 place, Point2 normal, double radius_mm) const {
  bool found = false;
  near({place.x_mm - radius_mm, place.y_mm - radius_mm}, {place.x_mm + radius_mm, place.y_mm + radius_mm},
       [&](std::uint32_t k) {
         if (found) return;
         const Segment& s = segments_[k];
         const double dx = s.b.x_mm - s.a.x_mm;
         const double dy = s.b.y_mm - s.a.y_mm;
         // The solid lies to the left, so outward is (dy, -dx).
         if (normal.x_mm * dy - normal.y_mm * dx <= 0) return;
         const double t = std::clamp(
             ((place.x_mm - s.a.x_mm) * dx + (place.y_mm - s.a.y_mm) * dy) / std::max(dx * dx + dy * dy, 1e-300), 0.0,
             1.0);
         found = std::hypot(s.a.x_mm + t * dx - place.x_mm, s.a.y_mm + t * dy - place.y_mm) <= radius_mm;
       });
  return found;
}

}  // namespace telefab::scan
