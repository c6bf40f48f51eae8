// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <optional>
#include <telefab/geometry/layer.hpp>
#include <vector>

namespace telefab::codec {

/// A place in lattice steps, not rounded.
struct Place {
  double x = 0;
  double y = 0;
};

struct GridPoint {
  std::int32_t x = 0;
  std::int32_t y = 0;
  friend bool operator==(GridPoint, GridPoint) = default;
};

/// The lattice that vertices are rounded to: origin at the header's lower bound, step = pitch / grid_per_pitch. One
/// multiplication and one addition lead back, so both sites get the same double.
class Grid {
 public:
  /// Fails with InvalidInput where the bounds hold more than 2^29 steps a side.
  [[nodiscard]] static Result<Grid> over(const StackHeader& header, std::uint32_t grid_per_pitch);
  /// The nearest lattice point inside the bounds.
  [[nodiscard]] GridPoint snap(Point2 point) const;
  [[nodiscard]] Point2 point(GridPoint p) const {
    return {origin_.x_mm + p.x * step_mm_, origin_.y_mm + p.y * step_mm_};
  }
  [[nodiscard]] Place place(Point2 p) const {
    return {(p.x_mm - origin_.x_mm) / step_mm_, (p.y_mm - origin_.y_mm) / step_mm_};
  }
  [[nodiscard]] double step_mm() const { return step_mm_; }
  [[nodiscard]] GridPoint most() const { return most_; }
  /// The ring on the lattice: neighbours that fall together become one; empty where no area of the same sign is left.
  [[nodiscard]] std::vector<GridPoint> snap(const Contour& ring) const;
  /// Fails with InvalidInput as Contour does.
  [[nodiscard]] Result<Contour> contour(const std::vector<GridPoint>& ring) const;

 private:
  Point2 origin_;
  double step_mm_ = 1;
  GridPoint most_;
};

}  // namespace telefab::codec
