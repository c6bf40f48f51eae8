// SPDX-License-Identifier: GPL-3.0-or-later
#include "ring_index.hpp"

#include <algorithm>
#include <cmath>

namespace telefab::fab {
namespace {

constexpr double kCellPx = 2;

double distance_to(PixelPlace a, PixelPlace b, PixelPlace p) {
  const double ux = b.x_px - a.x_px, uy = b.y_px - a.y_px;
  const double along = (p.x_px - a.x_px) * ux + (p.y_px - a.y_px) * uy, length2 = ux * ux + uy * uy;
  const double t = length2 > 0 ? std::clamp(along / length2, 0.0, 1.0) : 0;
  return std::hypot(a.x_px + t * ux - p.x_px, a.y_px + t * uy - p.y_px);
}

/// Turns counts at i + 1 into starts, then lists into their cells.
template <class EachCell>
void index_segments(std::size_t cells, std::size_t segments, std::vector<std::uint32_t>& starts,
                    std::vector<std::uint32_t>& list, const EachCell& each_cell) {
  starts.assign(cells + 1, 0);
  for (std::size_t s = 0; s < segments; ++s) each_cell(s, [&](std::size_t cell) { ++starts[cell + 1]; });
  for (std::size_t i = 0; i < cells; ++i) starts[i + 1] += starts[i];
  list.resize(starts.back());
  std::vector<std::uint32_t> next(starts.begin(), starts.end() - 1);
  for (std::size_t s = 0; s < segments; ++s)
    each_cell(s, [&](std::size_t cell) { list[next[cell]++] = static_cast<std::uint32_t>(s); });
}

}  // namespace

RingIndex::RingIndex(std::span<const Contour> rings, double pitch_mm) {
  double left = 1e300, right = -1e300, low = 1e300, high = -1e300;
  for (const Contour& ring : rings) {
    const auto v = ring.vertices();
    for (std::size_t i = 0, j = v.size() - 1; i < v.size(); j = i++) {
      segments_.push_back({{v[j].x_mm / pitch_mm, v[j].y_mm / pitch_mm}, {v[i].x_mm / pitch_mm, v[i].y_mm / pitch_mm}});
      left = std::min(left, segments_.back().a.x_px);
      right = std::max(right, segments_.back().a.x_px);
      low = std::min(low, segments_.back().a.y_px);
      high = std::max(high, segments_.back().a.y_px);
    }
  }
  if (segments_.empty()) return;
  box_.x = static_cast<int>(std::floor(left));
  box_.y = static_cast<int>(std::floor(low));
  box_.width = static_cast<int>(std::floor(right)) - box_.x + 1;
  box_.height = static_cast<int>(std::floor(high)) - box_.y + 1;
  columns_ = static_cast<int>(box_.width / kCellPx) + 1;
  rows_ = static_cast<int>(box_.height / kCellPx) + 1;
  index_segments(
      static_cast<std::size_t>(columns_) * static_cast<std::size_t>(rows_), segments_.size(), cell_starts_,
      cell_segments_, [&](std::size_t s, const auto& add) {
        const auto& a = segments_[s].a;  // no structured binding: older clangs cannot take one into a lambda
        const auto& b = segments_[s].b;
        const auto column = [&](double x) { return static_cast<int>((x - box_.x) / kCellPx); };
        const auto row = [&](double y) { return static_cast<int>((y - box_.y) / kCellPx); };
        const int r1 = row(std::max(a.y_px, b.y_px));
        for (int r = row(std::min(a.y_px, b.y_px)); r <= r1; ++r) {
          // Only the columns that the segment crosses in this row of cells.
          double x0 = std::min(a.x_px, b.x_px), x1 = std::max(a.x_px, b.x_px);
          if (a.y_px != b.y_px) {
            const auto x_at = [&](double y) {
              return std::clamp(a.x_px + (y - a.y_px) / (b.y_px - a.y_px) * (b.x_px - a.x_px), std::min(a.x_px, b.x_px),
                                std::max(a.x_px, b.x_px));
            };
            const double xa = x_at(box_.y + r * kCellPx), xb = x_at(box_.y + (r + 1) * kCellPx);
            x0 = std::max(x0, std::min(xa, xb));
            x1 = std::min(x1, std::max(xa, xb));
          }
          for (int c = column(x0); c <= column(x1); ++c)
            add(static_cast<std::size_t>(r) * static_cast<std::size_t>(columns_) + static_cast<std::size_t>(c));
        }
      });
  index_segments(static_cast<std::size_t>(box_.height), segments_.size(), row_starts_, row_segments_,
                 [&](std::size_t s, const auto& add) {
                   const auto& [a, b] = segments_[s];
                   const int last = static_cast<int>(std::floor(std::max(a.y_px, b.y_px))) - box_.y;
                   for (int r = static_cast<int>(std::floor(std::min(a.y_px, b.y_px))) - box_.y; r <= last; ++r)
                     add(static_cast<std::size_t>(r));
                 });
}

double RingIndex::distance(PixelPlace place, double limit_px) const {
  if (segments_.empty()) return limit_px;
  double best = limit_px;
  const double column = (place.x_px - box_.x) / kCellPx, row = (place.y_px - box_.y) / kCellPx;
  const int c0 = static_cast<int>(std::floor(column)), r0 = static_cast<int>(std::floor(row));
  const int most = static_cast<int>(std::ceil(limit_px / kCellPx)) + 1;
  // Everything in the square of cells around the place that reaches `ring` cells is searched; what lies beyond is at
  // least that far away.
  for (int ring = 0; ring <= most; ++ring) {
    const double nearest =
        ring == 0 ? 0
                  : kCellPx * (ring - 1) + kCellPx * std::min({column - c0, c0 + 1 - column, row - r0, r0 + 1 - row});
    if (nearest >= best) break;
    for (int r = std::max(0, r0 - ring); r <= std::min(rows_ - 1, r0 + ring); ++r) {
      const bool border = r == r0 - ring || r == r0 + ring;
      for (int c = c0 - ring; c <= c0 + ring; c += border || ring == 0 ? 1 : 2 * ring) {
        if (c < 0 || c >= columns_) continue;
        const std::size_t cell =
            static_cast<std::size_t>(r) * static_cast<std::size_t>(columns_) + static_cast<std::size_t>(c);
        for (std::uint32_t i = cell_starts_[cell]; i < cell_starts_[cell + 1]; ++i) {
          const Segment& s = segments_[cell_segments_[i]];
          best = std::min(best, distance_to(s.a, s.b, place));
        }
      }
    }
  }
  return best;
}

bool RingIndex::holds(PixelPlace place, double within_px) const {
  if (segments_.empty() || place.x_px < box_.x - within_px || place.x_px > box_.x + box_.width + within_px ||
      place.y_px < box_.y - within_px || place.y_px > box_.y + box_.height + within_px)
    return false;
  if (distance(place, within_px) < within_px) return true;
  const auto spans = spans_at(place.y_px);
  return (std::upper_bound(spans.begin(), spans.end(), place.x_px) - spans.begin()) % 2 != 0;
}

std::vector<double> RingIndex::spans_at(double y_px) const {
  const int row = static_cast<int>(std::floor(y_px)) - box_.y;
  if (segments_.empty() || row < 0 || row >= box_.height) return {};
  std::vector<std::pair<double, int>> crossings;
  for (std::uint32_t i = row_starts_[static_cast<std::size_t>(row)]; i < row_starts_[static_cast<std::size_t>(row) + 1];
       ++i) {
    const auto& [a, b] = segments_[row_segments_[i]];
    if ((a.y_px <= y_px) == (b.y_px <= y_px)) continue;
    const double x = a.x_px + (y_px - a.y_px) / (b.y_px - a.y_px) * (b.x_px - a.x_px);
    crossings.emplace_back(x, a.y_px < b.y_px ? -1 : 1);
  }
  std::sort(crossings.begin(), crossings.end());
  std::vector<double> spans;
  int winding = 0;
  for (const auto& [x, turn] : crossings) {
    const bool was = winding > 0;
    winding += turn;
    if (was != (winding > 0)) spans.push_back(x);
  }
  if (spans.size() % 2 != 0) spans.pop_back();
  return spans;
}

}  // namespace telefab::fab
