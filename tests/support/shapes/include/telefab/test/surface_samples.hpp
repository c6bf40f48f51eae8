// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <cstdint>
#include <telefab/test/analytic_field.hpp>

namespace telefab::test {

/// A place where the scanner saw nothing.
struct Hole {
  Vec3 centre_mm = Vec3::Zero();
  double radius_mm = 0;
};

struct SampleOptions {
  double spacing_mm = 1;         ///< > 0; mean spacing s = sqrt(area / points), blue noise
  double noise_mm = 0;           ///< Gaussian sigma of the positions, all directions
  double normal_noise_rad = 0;   ///< Gaussian sigma of the normals' tilt, both tangent directions
  double outlier_share = 0;      ///< [0, 1); as many more points, anywhere in the bounds, random normals, at the end
  double unevenness = 1;         ///< >= 1; the spacing grows along +x by this factor from end to end
  std::vector<Hole> holes = {};  ///< no sample inside
  std::uint64_t seed = 1;        ///< same seed and options, same samples
};

/// Oriented samples of a scan without the scanner; outliers last.
struct SurfaceSamples {
  std::vector<Vec3> points;
  std::vector<Vec3> normals;  ///< unit, outward
  double area_mm2 = 0;        ///< estimate, points * spacing^2 (even sampling only)
};

/// Even samples of the zero set: candidates in every cell the surface passes are projected onto it, and thrown darts
/// nearer than the spacing allows are dropped. Details thinner than a spacing may be missed.
[[nodiscard]] SurfaceSamples sample_surface(const AnalyticField& shape, const SampleOptions& options);

}  // namespace telefab::test
