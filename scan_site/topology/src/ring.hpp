// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <optional>
#include <span>
#include <stop_token>
#include <telefab/scan/section/plane_cursor.hpp>
#include <vector>

namespace telefab::scan::topology {

/// One contour at a height, solid on the left.
struct Ring {
  bool closed = false;  ///< false: the points are how far it was followed, and there is no area
  double z_mm = 0;
  double signed_area_mm2 = 0;
  std::vector<Vec2> points;  ///< of a closed one the last joins the first
  Vec2 low{0, 0};
  Vec2 high{0, 0};

  [[nodiscard]] bool is_hole() const { return signed_area_mm2 < 0; }
  /// Distance of p to the polygon if below `limit_mm`, else infinity.
  [[nodiscard]] double distance_mm(const Vec2& p, double limit_mm) const;
};

/// Moves p within its plane onto the surface, at most `limit_mm` away. None where the surface is level or out of reach.
[[nodiscard]] std::optional<Vec3> project_in_plane(FieldCursor& cursor, const Vec3& p, double h_mm, double limit_mm);

/// Walks the contour through `start` once around, or until it ends. None when `start` is not on the surface. A stop
/// ends it early.
[[nodiscard]] std::optional<Ring> trace_ring(const ScalarField& field, FieldCursor& cursor, const Vec3& start,
                                             std::stop_token stop);

/// The different closed rings through the seeds at height z; a seed within `same_mm` of a ring lies on it. Seeds that
/// lead nowhere within `limit_kernels` are left out. Contours that do not close are added to `open`: a seed beside one
/// of them is not followed again.
[[nodiscard]] std::vector<Ring> distinct_rings(const ScalarField& field, FieldCursor& cursor,
                                               std::span<const Vec3> seeds, double z_mm, double same_mm,
                                               double limit_kernels, std::vector<Ring>& open, std::stop_token stop);

}  // namespace telefab::scan::topology
