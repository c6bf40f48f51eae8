// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <optional>
#include <span>
#include <telefab/geometry/contour.hpp>
#include <telefab/scan/mls/scalar_field.hpp>
#include <vector>

namespace telefab::scan {

/// A place where two rings, or a ring and itself, touch or cross; none for a sound layer. O(n) expected.
[[nodiscard]] std::optional<Point2> find_crossing(std::span<const Contour> rings);

/// A ring that does not nest: a hole outside of every outer ring, an outer ring directly inside another. Its first
/// vertex; none for a sound layer.
[[nodiscard]] std::optional<Point2> find_bad_nesting(std::span<const Contour> rings);

/// Where the sample's tangent plane cuts the plane z: the section should pass there. None where the surface is too
/// level for that to mean anything, or the sample too far.
[[nodiscard]] std::optional<Point2> expected_crossing(const Vec3& point_mm, const Vec3& normal, double z_mm,
                                                      double most_shift_mm);

}  // namespace telefab::scan
