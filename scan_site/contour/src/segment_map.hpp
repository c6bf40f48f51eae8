// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <cstdint>
#include <span>
#include <telefab/geometry/contour.hpp>
#include <vector>

namespace telefab::scan {

/// The segments of rings in square buckets: who is near a place?
class SegmentMap {
 public:
  struct Segment {
    Point2 a, b;
    std::uint32_t ring;
    std::uint32_t index;  ///< of its first vertex
  };
  explicit SegmentMap(std::span<const Contour> rings);

  [[nodiscard]] std::span<const Segment> segments() const { return segments_; }
  /// Calls take(segment number) for each segment whose bucket meets the box; some come twice.
  template <class Take>
  void near(Point2 low, Point2 high, Take&& take) const {
    if (segments_.empty()) return;
    const int x0 = column(low.x_mm, low_.x_mm, nx_), x1 = column(high.x_mm, low_.x_mm, nx_);
    const int y0 = column(low.y_mm, low_.y_mm, ny_), y1 = column(high.y_mm, low_.y_mm, ny_);
    for (int j = y0; j <= y1; ++j)
      for (int i = x0; i <= x1; ++i) {
        const std::size_t bucket = static_cast<std::size_t>(j) * nx_ + i;
        for (std::uint32_t k = start_[bucket]; k < start_[bucket + 1]; ++k) take(entries_[k]);
      }
  }
  /// Whether a segment whose outward side agrees with the normal passes within the radius.
  [[nodiscard]] bool passes(Point2 place, Point2 normal, double radius_mm) const;

 private:
  [[nodiscard]] int column(double at, double low, int count) const {
    const double c = (at - low) / cell_;
    return c <= 0 ? 0 : c >= count ? count - 1 : static_cast<int>(c);
  }
  std::vector<Segment> segments_;
  Point2 low_;
  double cell_ = 1;
  int nx_ = 1, ny_ = 1;
  std::vector<std::uint32_t> start_, entries_;
};

}  // namespace telefab::scan
