// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <functional>
#include <span>
#include <telefab/test/analytic_field.hpp>
#include <telefab/test/surface_samples.hpp>

namespace telefab::test {

/// A body given by a distance, to be put together from others. Unlike an AnalyticField it answers everywhere and may
/// have any number of pieces; no scan is needed to know its sections.
struct Solid {
  std::function<double(const Vec3& place_mm)> distance_mm;  ///< to the surface, at least about; negative inside
  scan::Box3 box;                                           ///< holds all of it
};

[[nodiscard]] Solid solid_ball(const Vec3& centre_mm, double radius_mm);
/// A pin with round ends.
[[nodiscard]] Solid solid_pin(const Vec3& from_mm, const Vec3& to_mm, double radius_mm);
/// A box about the origin with rounded edges.
[[nodiscard]] Solid solid_box(const Vec3& half_sizes_mm, double edge_mm);
/// A ring about z.
[[nodiscard]] Solid solid_ring(double ring_mm, double tube_mm);
/// A wire wound about z, rising from z = 0 by `pitch_mm` a turn; round ends.
[[nodiscard]] Solid solid_spring(double radius_mm, double wire_mm, double pitch_mm, double turns);
[[nodiscard]] Solid joined(Solid a, Solid b);
[[nodiscard]] Solid turned(Solid solid, double degrees, const Vec3& axis);
[[nodiscard]] Solid shifted(Solid solid, const Vec3& by_mm);

/// Even oriented samples, blue noise: of thrown darts on the surface none nearer than three quarters of the spacing.
[[nodiscard]] SurfaceSamples sample_solid(const Solid& solid, double spacing_mm, std::uint64_t seed);
/// Rings of the exact slice at z of the body grown by `offset_mm`, counted on a fine grid.
[[nodiscard]] SliceCount count_slice(const Solid& solid, double z_mm, double pitch_mm, double offset_mm = 0);

}  // namespace telefab::test
