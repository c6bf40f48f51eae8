// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <Eigen/Core>
#include <telefab/scan/placing/standing.hpp>
#include <vector>

namespace telefab::scan {

/// A direction of the scan that may point up.
struct Direction {
  Eigen::Vector3d up;  ///< unit
  StandingSource source = StandingSource::Spread;
};

/// That of the file first, the other axes, those with a flat side of the scan, or the side it shows nothing of, exactly
/// below, and so many spread evenly; none twice (within 0.2 degrees).
[[nodiscard]] std::vector<Direction> directions_of(const std::vector<Eigen::Vector3f>& normals,
                                                   const std::vector<float>& areas, std::uint32_t spread);

/// Degrees about z that lay the smallest rectangle around the places along x and y, its longer side along x where
/// `wide`; the smallest of turns that do. (-90, 90].
[[nodiscard]] double turn_along(const std::vector<Eigen::Vector2d>& places, bool wide);

}  // namespace telefab::scan
