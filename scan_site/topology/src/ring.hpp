#pragma once
#include <optional>
#include <span>
#include <telefab/scan/mls/scalar_field.hpp>
#include <vector>

namespace telefab::scan::topology {

using Vec2 = Eigen::Vector2d;

/// One closed contour at a height, solid on the left.
struct Ring {
  double z_mm = 0;
  double signed_area_mm2 = 0;
  std::vector<Vec2> points;  ///< last joins first
  Vec2 low{0, 0};
  Vec2 high{0, 0};

  [[nodiscard]] bool is_hole() const { return signed_area_mm2 < 0; }
  /// Distance of p to the polygon's boundary if below `limit_mm`, else infinity.
  [[nodiscard]] double distance_mm(const Vec2& p, double limit_mm) const;
};

/// Moves p within its plane onto the surface, at most `limit_mm` away. None where the surface is level or out of reach.
[[nodiscard]] std::optional<Vec3> onto_level(FieldCursor& cursor, const Vec3& p, double h_mm, double limit_mm);

/// Walks the contour through `start` (on the surface) once around. None when it does not close.
[[nodiscard]] std::optional<Ring> trace_ring(const ScalarField& field, FieldCursor& cursor, const Vec3& start);

/// The different rings through the seeds at height z; a seed within `same_mm` of a ring lies on it. Seeds that lead
/// nowhere within `limit_kernels` are left out.
[[nodiscard]] std::vector<Ring> distinct_rings(const ScalarField& field, FieldCursor& cursor,
                                               std::span<const Vec3> seeds, double z_mm, double same_mm,
                                               double limit_kernels);

}  // namespace telefab::scan::topology
