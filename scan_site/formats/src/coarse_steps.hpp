// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <optional>
#include <span>
#include <string>
#include <telefab/scan/cloud/point_cloud.hpp>

namespace telefab::scan {

struct CoarseSteps {
  double step = 0;   ///< the coarsest of the three axes, unit of the file
  std::string text;  ///< one sentence for people
};

/// Whether positions far from the origin were rounded to steps that are coarse against the spacing of the points, as
/// map coordinates are when written as 32-bit floats or with six digits. Nothing for exact grids near the origin.
[[nodiscard]] std::optional<CoarseSteps> coarse_steps_of(std::span<const Vec3> points);

}  // namespace telefab::scan
