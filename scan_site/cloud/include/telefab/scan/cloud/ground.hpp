// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <Eigen/Core>
#include <optional>
#include <span>
#include <stop_token>

namespace telefab::scan {

/// A plane that holds many of the points, beyond all others on every side, with the others on one side of it. Frame
/// and unit of the points.
struct GroundPlane {
  Eigen::Vector3d place, up;  ///< a point of the plane; unit, towards what stands on it
  double share = 0;           ///< of the points
  double thickness = 0;       ///< points nearer to the plane than this are of it
};

/// The ground that something stands on, if there is one; nothing too where the points are too few or the search was
/// stopped. Cost: that of the 16 nearest neighbours of every point.
[[nodiscard]] std::optional<GroundPlane> find_ground(std::span<const Eigen::Vector3f> points, std::stop_token stop);

}  // namespace telefab::scan
