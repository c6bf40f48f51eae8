// SPDX-License-Identifier: GPL-3.0-or-later
#include <algorithm>
#include <cmath>
#include <telefab/scan/contour/layer_checks.hpp>

#include "segment_map.hpp"

namespace telefab::scan {
namespace {

double turn(Point2 a, Point2 b, Point2 c) {
  return (b.x_mm - a.x_mm) * (c.y_mm - a.y_mm) - (b.y_mm - a.y_mm) * (c.x_mm - a.x_mm);
}
bool between(Point2 a, Point2 b, Point2 p) {
  return p.x_mm >= std::min(a.x_mm, b.x_mm) && p.x_mm <= std::max(a.x_mm, b.x_mm) &&
         p.y_mm >= std::min(a.y_mm, b.y_mm) && p.y_mm <= std::max(a.y_mm, b.y_mm);
}
/// Segments that share a point.
bool meet(Point2 a, Point2 b, Point2 c, Point2 d) {
  const double t1 = turn(a, b, c), t2 = turn(a, b, d), t3 = turn(c, d, a), t4 = turn(c, d, b);
  if (((t1 > 0) != (t2 > 0)) && t1 != 0 && t2 != 0 && ((t3 > 0) != (t4 > 0)) && t3 != 0 && t4 != 0) return true;
  return (t1 == 0 && between(a, b, c)) || (t2 == 0 && between(a, b, d)) || (t3 == 0 && between(c, d, a)) ||
         (t4 == 0 && between(c, d, b));
}

}  // namespace

std::optional<Point2> find_crossing(std::span<const Contour> rings) {
  const SegmentMap map{rings};
  const auto segments = map.segments();
  for (std::uint32_t k = 0; k < segments.size(); ++k) {
    const auto& s = segments[k];
    const auto count = static_cast<std::uint32_t>(rings[s.ring].vertices().size());
    bool found = false;
    map.near({std::min(s.a.x_mm, s.b.x_mm), std::min(s.a.y_mm, s.b.y_mm)},
             {std::max(s.a.x_mm, s.b.x_mm), std::max(s.a.y_mm, s.b.y_mm)}, [&](std::uint32_t other) {
               if (found || other <= k) return;
               const auto& o = segments[other];
               if (o.ring == s.ring && ((s.index + 1) % count == o.index || (o.index + 1) % count == s.index)) {
                 // Neighbours share a vertex; they cross only if one folds back onto the other.
                 const Point2 shared = (s.index + 1) % count == o.index ? s.b : s.a;
                 const Point2 own_end = shared == s.b ? s.a : s.b;
                 const Point2 its = shared == o.a ? o.b : o.a;
                 found = turn(own_end, shared, its) == 0 &&
                         (between(own_end, shared, its) || between(shared, its, own_end));
                 return;
               }
               found = meet(s.a, s.b, o.a, o.b);
             });
    if (found) return s.a;
  }
  return std::nullopt;
}

std::optional<Point2> find_bad_nesting(std::span<const Contour> rings) {
  std::vector<Bounds2> boxes;
  boxes.reserve(rings.size());
  for (const Contour& r : rings) boxes.push_back(r.bounds());
  for (std::size_t i = 0; i < rings.size(); ++i) {
    const Point2 p = rings[i].vertices()[0];
    int depth = 0;
    for (std::size_t j = 0; j < rings.size(); ++j) {
      if (j == i || p.x_mm < boxes[j].min.x_mm || p.x_mm > boxes[j].max.x_mm || p.y_mm < boxes[j].min.y_mm ||
          p.y_mm > boxes[j].max.y_mm)
        continue;
      if (contains(rings[j], p)) ++depth;
    }
    if ((depth % 2 == 1) != rings[i].is_hole()) return p;
  }
  return std::nullopt;
}

}  // namespace telefab::scan
