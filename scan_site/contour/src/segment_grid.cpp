#include "segment_grid.hpp"

#include <algorithm>
#include <cmath>

namespace telefab::scan::contour {

std::int64_t SegmentGrid::cell(double v_mm) const { return static_cast<std::int64_t>(std::floor(v_mm / cell_mm_)); }

void SegmentGrid::add(std::span<const Point2> ring) {
  for (std::size_t i = 0; i < ring.size(); ++i) {
    const Point2& a = ring[i];
    const Point2& b = ring[i + 1 == ring.size() ? 0 : i + 1];
    const auto number = static_cast<std::uint32_t>(segments_.size());
    segments_.push_back({{a.x_mm, a.y_mm}, {b.x_mm, b.y_mm}});
    const std::pair<std::int64_t, std::int64_t> columns = std::minmax({cell(a.x_mm), cell(b.x_mm)});
    const std::pair<std::int64_t, std::int64_t> rows = std::minmax({cell(a.y_mm), cell(b.y_mm)});
    for (std::int64_t j = rows.first; j <= rows.second; ++j)
      for (std::int64_t k = columns.first; k <= columns.second; ++k) {
        const auto [at, fresh] = cells_.number(key(k, j));
        if (fresh) first_.push_back(KeyTable::kNone);
        entries_.push_back({number, first_[at]});
        first_[at] = static_cast<std::uint32_t>(entries_.size() - 1);
      }
  }
}

bool SegmentGrid::runs_beside(const Vec2& p, const Vec2& outward, double reach_mm) const {
  const std::int64_t ci = cell(p.x());
  const std::int64_t cj = cell(p.y());
  for (std::int64_t j = cj - 1; j <= cj + 1; ++j)
    for (std::int64_t i = ci - 1; i <= ci + 1; ++i) {
      const std::uint32_t at = cells_.known(key(i, j));
      if (at == KeyTable::kNone) continue;
      for (std::uint32_t e = first_[at]; e != KeyTable::kNone; e = entries_[e].next) {
        const std::uint32_t s = entries_[e].segment;
        const Vec2 side = segments_[s].to - segments_[s].from;
        if (side.y() * outward.x() - side.x() * outward.y() < 0) continue;  // the right-hand normal looks away
        const Vec2 d = p - segments_[s].from;
        const double share = std::clamp(d.dot(side) / std::max(side.squaredNorm(), 1e-300), 0.0, 1.0);
        if ((d - share * side).squaredNorm() < reach_mm * reach_mm) return true;
      }
    }
  return false;
}

}  // namespace telefab::scan::contour
