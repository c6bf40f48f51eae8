// SPDX-License-Identifier: GPL-3.0-or-later
#include "segment_grid.hpp"

#include <algorithm>
#include <cmath>

namespace telefab::scan::contour {

std::int32_t SegmentGrid::cell(double v_mm) const {
  const double v = std::clamp(v_mm * per_mm_, -1e9, 1e9);
  const auto whole = static_cast<std::int32_t>(v);
  return whole - (v < whole ? 1 : 0);
}

std::size_t SegmentGrid::slot_of(std::int32_t i, std::int32_t j) const {
  const std::uint64_t key = static_cast<std::uint64_t>(static_cast<std::uint32_t>(i)) << 32U |
                            static_cast<std::uint64_t>(static_cast<std::uint32_t>(j));
  std::size_t at = (key * 0x9e3779b97f4a7c15ULL >> 32U) & (slots_.size() - 1);
  while (slots_[at].entry != kNone && (slots_[at].i != i || slots_[at].j != j)) at = (at + 1) & (slots_.size() - 1);
  return at;
}

void SegmentGrid::grow() {
  std::vector<Slot> old(std::max<std::size_t>(1024, 2 * slots_.size()));
  old.swap(slots_);
  for (const Slot& s : old)
    if (s.entry != kNone) slots_[slot_of(s.i, s.j)] = s;
}

void SegmentGrid::add(std::span<const Point2> ring) {
  add_path(ring);
  if (!ring.empty()) add_segment(ring.back(), ring.front());
}

void SegmentGrid::add_path(std::span<const Point2> way) {
  for (std::size_t i = 1; i < way.size(); ++i) add_segment(way[i - 1], way[i]);
}

void SegmentGrid::add_segment(const Point2& from, const Point2& to) {
  const auto number = static_cast<std::uint32_t>(segments_.size());
  segments_.push_back({{from.x_mm, from.y_mm}, {to.x_mm, to.y_mm}});
  const auto [left, right] = std::minmax({cell(from.x_mm), cell(to.x_mm)});
  const auto [low, high] = std::minmax({cell(from.y_mm), cell(to.y_mm)});
  for (std::int32_t y = low; y <= high; ++y)
    for (std::int32_t x = left; x <= right; ++x) {
      if (2 * (cells_ + 1) > slots_.size()) grow();
      Slot& slot = slots_[slot_of(x, y)];
      if (slot.entry == kNone) ++cells_;
      entries_.push_back({number, slot.entry});
      slot = {x, y, static_cast<std::uint32_t>(entries_.size() - 1)};
    }
}

bool SegmentGrid::runs_beside(const Vec2& p, const Vec2& outward, double reach_mm) const {
  if (slots_.empty()) return false;
  const double reach2 = reach_mm * reach_mm;
  const std::int32_t left = cell(p.x() - reach_mm), right = cell(p.x() + reach_mm);
  const std::int32_t low = cell(p.y() - reach_mm), high = cell(p.y() + reach_mm);
  for (std::int32_t y = low; y <= high; ++y)
    for (std::int32_t x = left; x <= right; ++x)
      for (std::uint32_t e = slots_[slot_of(x, y)].entry; e != kNone; e = entries_[e].next) {
        const Segment& s = segments_[entries_[e].segment];
        const Vec2 side = s.to - s.from;
        if (side.y() * outward.x() - side.x() * outward.y() < 0) continue;  // the right-hand normal looks away
        const Vec2 d = p - s.from;
        const double share = std::clamp(d.dot(side) / std::max(side.squaredNorm(), 1e-300), 0.0, 1.0);
        if ((d - share * side).squaredNorm() < reach2) return true;
      }
  return false;
}

}  // namespace telefab::scan::contour
