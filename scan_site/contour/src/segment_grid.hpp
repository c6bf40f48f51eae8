#pragma once
#include <Eigen/Core>
#include <cstdint>
#include <span>
#include <telefab/geometry/contour.hpp>
#include <vector>

#include "key_table.hpp"

namespace telefab::scan::contour {

using Vec2 = Eigen::Vector2d;

/// Segments of contours by cells of the plane, to ask which run beside a point.
class SegmentGrid {
 public:
  explicit SegmentGrid(double cell_mm) : cell_mm_{cell_mm} {}
  void add(std::span<const Point2> ring);
  /// True when a segment whose solid lies opposite to `outward` runs within `reach_mm` (at most one cell) of p.
  [[nodiscard]] bool runs_beside(const Vec2& p, const Vec2& outward, double reach_mm) const;

 private:
  struct Segment {
    Vec2 from, to;
  };
  [[nodiscard]] std::int64_t cell(double v_mm) const;
  static std::uint64_t key(std::int64_t i, std::int64_t j) {
    return static_cast<std::uint64_t>(i) << 32 ^ (static_cast<std::uint64_t>(j) & 0xffffffffu);
  }
  struct Entry {
    std::uint32_t segment;
    std::uint32_t next;  ///< index into entries_ of the cell's next one
  };
  double cell_mm_;
  std::vector<Segment> segments_;
  KeyTable cells_;
  std::vector<std::uint32_t> first_;  ///< by number of the cell
  std::vector<Entry> entries_;
};

}  // namespace telefab::scan::contour
