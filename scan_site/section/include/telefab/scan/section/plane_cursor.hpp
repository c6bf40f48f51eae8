// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <cmath>
#include <cstdint>
#include <optional>
#include <telefab/geometry/contour.hpp>
#include <telefab/scan/mls/scalar_field.hpp>

namespace telefab::scan {

using Vec2 = Eigen::Vector2d;

/// The field seen within a plane of one height.
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
  /// Along the section, solid on the left; unit, and only where it is steep.
  [[nodiscard]] Vec2 tangent() const { return Vec2{-gy, gx} / steep; }
  [[nodiscard]] Vec2 point() const { return {at.x_mm, at.y_mm}; }
};

/// How Newton may go in a plane.
struct NewtonRule {
  double longest_step_mm = 0;  ///< longer ones are cut to it
  double most_move_mm = 0;     ///< farther from the start than this it has failed
  double least_steep = 1e-4;   ///< where the surface is more level it has failed
  int most_steps = 12;
};

/// What a sample on the way says.
enum class Arrival : std::uint8_t {
  GoOn,
  Here,       ///< this is the place
  AfterStep,  ///< the step from here leads to the place, and is not looked at again
};

/// Evaluates a field in one plane. Not for two threads at once; the cursor must outlive it.
class PlaneCursor {
 public:
  PlaneCursor(FieldCursor& cursor, double z_mm) : cursor_{cursor}, z_mm_{z_mm} {}

  [[nodiscard]] PlaneSample at(Point2 p) {
    ++evaluations_;
    const FieldSample f = cursor_.at({p.x_mm, p.y_mm, z_mm_});
    const double gx = f.gradient.x(), gy = f.gradient.y();
    return {p, f.value_mm, gx, gy, std::sqrt(gx * gx + gy * gy), f.closeness_mm, f.in_reach};
  }

  /// Newton onto g = 0 without leaving the plane. `arrival(sample, length of the whole step from it, steps before)`
  /// says when that is near enough. None where it does not get there by the rule.
  template <class Judge>
  [[nodiscard]] std::optional<PlaneSample> project(Point2 from, const NewtonRule& rule, const Judge& arrival) {
    Point2 p = from;
    for (int i = 0; i < rule.most_steps; ++i) {
      PlaneSample s = at(p);
      if (!s.in_reach || !(s.steep > rule.least_steep)) return std::nullopt;
      double step = -s.value_mm / (s.steep * s.steep);
      const double length = std::abs(step) * s.steep;
      const Arrival judged = arrival(s, length, i);
      if (judged == Arrival::Here) return s;
      if (length > rule.longest_step_mm) step *= rule.longest_step_mm / length;
      p = {p.x_mm + step * s.gx, p.y_mm + step * s.gy};
      if (distance_mm(p, from) > rule.most_move_mm) return std::nullopt;
      if (judged == Arrival::AfterStep) {
        s.at = p;
        return s;
      }
    }
    return std::nullopt;
  }

  /// The same, to within `tolerance_mm` of zero, measured along the section's normal.
  [[nodiscard]] std::optional<PlaneSample> project_in_plane(Point2 from, double most_move_mm, double tolerance_mm) {
    return project(from, {0.5 * most_move_mm, most_move_mm, 1e-3, 12}, [&](const PlaneSample& s, double, int) {
      return std::abs(s.value_mm) <= tolerance_mm * s.steep ? Arrival::Here : Arrival::GoOn;
    });
  }

  [[nodiscard]] double z_mm() const { return z_mm_; }
  [[nodiscard]] std::uint64_t evaluations() const { return evaluations_; }

 private:
  FieldCursor& cursor_;
  double z_mm_;
  std::uint64_t evaluations_ = 0;
};

/// Where the tangent plane of a sample cuts the plane z, which is where the section should pass. None where the
/// in-plane part of the unit normal is at most `least_across`, so that it means nothing, or where that is farther than
/// `most_shift_mm`.
[[nodiscard]] std::optional<Vec2> first_order_crossing(const Vec3& point_mm, const Vec3& normal, double z_mm,
                                                       double most_shift_mm, double least_across);

}  // namespace telefab::scan
