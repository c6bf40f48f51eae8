// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <cmath>
#include <cstdint>
#include <optional>
#include <telefab/geometry/contour.hpp>
#include <telefab/scan/mls/scalar_field.hpp>

namespace telefab::scan {

/// The field seen within the plane z.
struct PlaneSample {
  Point2 at;
  double value_mm = 0;
  double gx = 0;  ///< in-plane gradient
  double gy = 0;
  double steep = 0;  ///< its length: 1 at a vertical wall, 0 where the surface is level
  double closeness_mm = 0;
  bool in_reach = false;

  /// Outward unit normal of the section; zero where there is none.
  [[nodiscard]] Point2 normal() const { return steep > 0 ? Point2{gx / steep, gy / steep} : Point2{}; }
};

class PlaneCursor {
 public:
  PlaneCursor(FieldCursor& cursor, double z_mm) : cursor_{cursor}, z_mm_{z_mm} {}

  [[nodiscard]] PlaneSample at(Point2 p) {
    ++evaluations_;
    const FieldSample f = cursor_.at({p.x_mm, p.y_mm, z_mm_});
    return {p,
            f.value_mm,
            f.gradient.x(),
            f.gradient.y(),
            std::hypot(f.gradient.x(), f.gradient.y()),
            f.closeness_mm,
            f.in_reach};
  }

  /// In-plane Newton onto g = 0; none if it does not arrive within `most_move_mm` of p and `tolerance_mm` of zero
  /// (measured along the section's normal).
  [[nodiscard]] std::optional<PlaneSample> project_in_plane(Point2 p, double most_move_mm, double tolerance_mm) {
    PlaneSample s = at(p);
    for (int i = 0; i < 12; ++i) {
      if (!s.in_reach || !(s.steep > 1e-3)) return std::nullopt;
      if (std::abs(s.value_mm) <= tolerance_mm * s.steep) return s;
      double step = -s.value_mm / (s.steep * s.steep);
      const double length = std::abs(step) * s.steep;
      if (length > 0.5 * most_move_mm) step *= 0.5 * most_move_mm / length;
      const Point2 next{s.at.x_mm + step * s.gx, s.at.y_mm + step * s.gy};
      if (std::hypot(next.x_mm - p.x_mm, next.y_mm - p.y_mm) > most_move_mm) return std::nullopt;
      s = at(next);
    }
    return std::nullopt;
  }

  [[nodiscard]] double z_mm() const { return z_mm_; }
  [[nodiscard]] std::uint64_t evaluations() const { return evaluations_; }

 private:
  FieldCursor& cursor_;
  double z_mm_;
  std::uint64_t evaluations_ = 0;
};

inline double distance_mm(Point2 a, Point2 b) { return std::hypot(b.x_mm - a.x_mm, b.y_mm - a.y_mm); }

/// How far an arc with these end normals bulges over its chord: L sin(angle) / 4 by the worse end.
inline double sagitta_mm(const PlaneSample& a, const PlaneSample& b) {
  const double dx = b.at.x_mm - a.at.x_mm;
  const double dy = b.at.y_mm - a.at.y_mm;
  const Point2 na = a.normal();
  const Point2 nb = b.normal();
  return std::max(std::abs(na.x_mm * dx + na.y_mm * dy), std::abs(nb.x_mm * dx + nb.y_mm * dy)) / 4;
}

}  // namespace telefab::scan
