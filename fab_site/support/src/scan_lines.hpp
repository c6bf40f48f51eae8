// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <algorithm>
#include <cmath>
#include <telefab/fab/region/region.hpp>
#include <utility>
#include <vector>

namespace telefab::fab {

/// Level lines and where edges of rings cross them. Line i lies at y = origin + (i + 0.5) * step; any unit, the same
/// for all.
class ScanLines {
 public:
  ScanLines(double origin, double step, int lines)
      : origin_{origin}, step_{step}, crossings_(static_cast<std::size_t>(std::max(0, lines))) {}

  /// An edge of a ring; both ends are finite. Lines cross it at its lower end, not at its upper one.
  void add(double from_x, double from_y, double to_x, double to_y) {
    const int turn = to_y > from_y ? 1 : -1;
    if (turn < 0) std::swap(from_x, to_x), std::swap(from_y, to_y);
    if (from_y == to_y) return;
    const double slope = (to_x - from_x) / (to_y - from_y);
    const double first = std::max(0.0, std::ceil((from_y - origin_) / step_ - 0.5));
    for (auto line = static_cast<std::size_t>(first); line < crossings_.size(); ++line) {
      const double y = origin_ + (static_cast<double>(line) + 0.5) * step_;
      if (y >= to_y) break;
      if (y >= from_y) crossings_[line].emplace_back(from_x + (y - from_y) * slope, turn);
    }
  }

  /// All edges of a ring, in millimetres.
  void add(const GridRing& ring) {
    for (std::size_t i = 0; i < ring.size(); ++i) {
      const Point2 a = to_mm(ring[i]), b = to_mm(ring[i + 1 < ring.size() ? i + 1 : 0]);
      add(a.x_mm, a.y_mm, b.x_mm, b.y_mm);
    }
  }

  /// Calls `span(line, from_x, to_x)` for what the rings enclose by a winding number that is not zero, line by line,
  /// rising. Sorts, so it is called once all edges are in.
  template <class Span>
  void for_spans(const Span& span) {
    for (std::size_t line = 0; line < crossings_.size(); ++line) {
      auto& at = crossings_[line];
      std::sort(at.begin(), at.end());
      int winding = 0;
      for (std::size_t i = 0; i + 1 < at.size(); ++i) {
        winding += at[i].second;
        if (winding != 0) span(static_cast<int>(line), at[i].first, at[i + 1].first);
      }
    }
  }

 private:
  double origin_, step_;
  std::vector<std::vector<std::pair<double, int>>> crossings_;  ///< x and turn, by line
};

}  // namespace telefab::fab
