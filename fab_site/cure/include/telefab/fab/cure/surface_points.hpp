// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <cstddef>
#include <telefab/fab/cure/cured_solid.hpp>
#include <vector>

namespace telefab::fab {

/// A point of the cured solid's surface. Print frame: millimetres, x and y of the build frame, z up from the platform.
struct SurfacePoint {
  float x_mm = 0, y_mm = 0, z_mm = 0;
  float normal_x = 0, normal_y = 0, normal_z = 0;  ///< outwards, unit length
  friend bool operator==(const SurfacePoint&, const SurfacePoint&) = default;
};

/// Where lines of a lattice leave the solid within one layer: along x and y at its middle, along z at the middles of
/// pixels, `spacing_px` (whole, 1 to 64) apart. A patch is taken from the lines that meet it most nearly head on, so
/// the density is even to a factor of 1.7. Undersides lie where the depth ends, faces on top where less is cured above.
[[nodiscard]] std::vector<SurfacePoint> surface_points(const CuredLayer& layer, int spacing_px);

/// PLY, binary little-endian, floats x y z nx ny nz in millimetres; `comment` is one line.
[[nodiscard]] std::vector<std::byte> to_ply(std::span<const SurfacePoint> points, std::string_view comment);

}  // namespace telefab::fab
