// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <array>
#include <optional>
#include <stop_token>
#include <string>
#include <telefab/base/result.hpp>
#include <telefab/scan/cloud/point_cloud.hpp>
#include <telefab/scan/formats/write_cloud.hpp>
#include <telefab/scan/registration/align.hpp>
#include <vector>

namespace telefab::scan {

struct MeasureOptions {
  bool align_first = true;       ///< false = compare as the files stand
  std::optional<double> height;  ///< > 0; what 100 % is, unit of the clouds; unset = extent of the reference along z
  std::optional<double>
      max_distance;  ///< > 0; farther points are not matched and counted as such; unset = 10 % of the height
  [[nodiscard]] Result<void> validate() const;
};

/// Signed distances of the built points from the reference surface: positive = outside it, material too much.
struct Deviation {
  double min = 0, max = 0;
  double p1 = 0, p50 = 0, p99 = 0;  ///< percentiles
  double rms = 0;
  double bias = 0;                                   ///< mean
  double size_mean = 0, size_p95 = 0, size_max = 0;  ///< without the signs
};

struct Measurement {
  RigidMotion motion = RigidMotion::Identity();  ///< built to reference
  double align_rms = 0;                          ///< of the last ICP round, 0 if not aligned
  double height = 0;                             ///< what 100 % is
  Deviation deviation;                           ///< unit of the clouds
  std::size_t compared = 0;
  std::size_t unmatched = 0;     ///< built points with no reference within max_distance
  std::vector<double> distance;  ///< one a built point, NaN where unmatched
};

/// Rigid alignment (point-to-plane ICP from the boxes' middles and the 24 turns of a cube, best fit kept, unless the
/// clouds already lie together), then the signed closest-point distance of every built point to the plane of the
/// nearest reference point. Both clouds have outward normals.
/// Fails: InvalidInput (a cloud without normals or points), NotConverged (no alignment fits), Cancelled.
[[nodiscard]] Result<Measurement> measure(const PointCloud& reference, const PointCloud& built,
                                          const MeasureOptions& options, std::stop_token stop);

/// Blue (too little) over light grey to orange (too much), full at +-`range`; dark grey where unmatched.
[[nodiscard]] std::vector<PointColour> heat_colours(const Measurement& measurement, double range);

/// Lengths as they are and in % of the height, and the 4x4 motion.
[[nodiscard]] std::string to_json(const Measurement& measurement);

}  // namespace telefab::scan
