// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <telefab/scan/placing/standing.hpp>

#include "solid_grid.hpp"

namespace telefab::scan {

/// How a part stands in the build frame.
struct Stance {
  Eigen::Matrix3d to_build;  ///< of places relative to the origin of the cloud, in millimetres
  Box3 box_mm;               ///< of to_build * samples
};

/// Builds a part up layer by layer on a grid, as the planner of the fab does on contours: what no layer below carries,
/// anchors under it, pins to the nearest free column or to the part. All figures but `stepped_mm2` and `surface_mm2`;
/// `trapped_mm3` and `stability` only where `in_full`.
[[nodiscard]] StandingFigures grown(const SolidGrid& grid, const Stance& stance, const MachineProfile& machine,
                                    double layer_mm, bool in_full);

}  // namespace telefab::scan
