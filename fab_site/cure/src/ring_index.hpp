// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <span>
#include <telefab/fab/cure/dose_field.hpp>
#include <telefab/geometry/contour.hpp>
#include <vector>

namespace telefab::fab {

/// Rings of a layer in pixels: distances to them, and which points lie inside.
class RingIndex {
 public:
  RingIndex(std::span<const Contour> rings, double pitch_mm);

  [[nodiscard]] bool empty() const { return segments_.empty(); }
  [[nodiscard]] const PixelBox& box() const { return box_; }
  /// Exact; `limit_px` where nothing is nearer.
  [[nodiscard]] double distance(PixelPlace place, double limit_px) const;
  /// Inside, or within a distance of a ring.
  [[nodiscard]] bool holds(PixelPlace place, double within_px) const;
  /// Where the horizontal line at y passes from outside to inside and back, by the winding number: pairs of x, sorted.
  [[nodiscard]] std::vector<double> spans_at(double y_px) const;

 private:
  struct Segment {
    PixelPlace a, b;
  };
  std::vector<Segment> segments_;
  PixelBox box_;  ///< of all segments
  int columns_ = 0, rows_ = 0;
  std::vector<std::uint32_t> cell_starts_, cell_segments_;
  std::vector<std::uint32_t> row_starts_, row_segments_;  ///< segments by pixel row
};

}  // namespace telefab::fab
