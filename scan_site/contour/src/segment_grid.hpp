// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <Eigen/Core>
#include <cstdint>
#include <span>
#include <telefab/geometry/contour.hpp>
#include <telefab/scan/section/plane_cursor.hpp>
#include <vector>

namespace telefab::scan::contour {

/// Segments of contours by cells of the plane, to ask which run beside a point.
class SegmentGrid {
 public:
  /// For questions of up to `reach_mm`: a place asks the four cells about it.
  explicit SegmentGrid(double reach_mm) : per_mm_{0.5 / reach_mm} {}
  void add(std::span<const Point2> ring);
  /// The same without the segment from the last point to the first.
  void add_path(std::span<const Point2> way);
  /// True when a segment whose solid lies opposite to `outward` runs within `reach_mm` of p.
  [[nodiscard]] bool runs_beside(const Vec2& p, const Vec2& outward, double reach_mm) const;

 private:
  static constexpr std::uint32_t kNone = 0xffffffffU;
  struct Segment {
    Vec2 from, to;
  };
  struct Entry {
    std::uint32_t segment;
    std::uint32_t next;  ///< index into entries_ of the cell's next one
  };
  /// Of an open-addressing table; entry kNone: free.
  struct Slot {
    std::int32_t i, j;
    std::uint32_t entry = kNone;
  };
  void add_segment(const Point2& from, const Point2& to);
  [[nodiscard]] std::int32_t cell(double v_mm) const;
  [[nodiscard]] std::size_t slot_of(std::int32_t i, std::int32_t j) const;
  void grow();

  double per_mm_;
  std::vector<Segment> segments_;
  std::vector<Entry> entries_;
  std::vector<Slot> slots_;
  std::size_t cells_ = 0;
};

}  // namespace telefab::scan::contour
