// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <Eigen/Core>
#include <cstdint>
#include <optional>
#include <vector>

namespace telefab::scan {

using Vec3 = Eigen::Vector3d;

/// Points of a scan, in the scanner's frame and the file's unit until scaled to millimetres by placement.
/// Positions are float relative to `origin`, so that 24 bytes a point hold a scan anywhere on Earth.
/// Invariant kept by the readers: all finite; normals is empty or has one unit vector a point, outward;
/// confidence is empty or has one value in [0, 1] a point.
struct PointCloud {
  Vec3 origin = Vec3::Zero();
  std::vector<Eigen::Vector3f> points;
  std::vector<Eigen::Vector3f> normals;
  std::vector<float> confidence;
  std::optional<double> unit_mm;  ///< millimetres in one unit of the positions, where the file or somebody states it

  [[nodiscard]] std::size_t size() const { return points.size(); }
  [[nodiscard]] bool has_normals() const { return !normals.empty(); }
};

}  // namespace telefab::scan
