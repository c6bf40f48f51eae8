// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <cstddef>
#include <telefab/scan/cloud/point_cloud.hpp>

namespace telefab::bench {

enum class CloudKind {
  Torus = 0,  ///< upright ring, 100 mm high, evenly sampled: one kernel width
  Bumpy = 1,  ///< the bumpy ball of the tests, unevenly sampled: a width a sample
};

/// About `points` samples with exact normals, placed in the build frame. The same every time: seeded.
[[nodiscard]] scan::PointCloud make_cloud(CloudKind kind, std::size_t points);

}  // namespace telefab::bench
