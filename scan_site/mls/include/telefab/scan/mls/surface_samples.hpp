// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <cstdint>
#include <span>
#include <telefab/scan/mls/scalar_field.hpp>
#include <vector>

namespace telefab::scan {

/// Points of the scan in the build frame, millimetres, with outward unit normals; same length.
struct SurfaceSamples {
  std::vector<Vec3> points;
  std::vector<Vec3> normals;
  std::vector<std::uint8_t> in_gap = {};  ///< 1: nobody measured it (GapSample); empty: all are measured
};

/// The same, of somebody else's, who must outlive the view.
struct SampleView {
  std::span<const Vec3> points;
  std::span<const Vec3> normals;

  SampleView() = default;
  SampleView(std::span<const Vec3> the_points, std::span<const Vec3> the_normals)
      : points{the_points}, normals{the_normals} {}
  SampleView(const SurfaceSamples& samples)  // NOLINT(google-explicit-constructor): as a span of a vector
      : points{samples.points}, normals{samples.normals} {}
};

}  // namespace telefab::scan
