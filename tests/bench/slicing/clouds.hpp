// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <cstddef>
#include <functional>
#include <telefab/scan/cloud/point_cloud.hpp>

namespace telefab::bench {

enum class CloudKind {
  Torus = 0,  ///< upright ring, 100 mm high, evenly sampled: one kernel width
  Bumpy = 1,  ///< the bumpy ball of the tests, unevenly sampled: a width a sample
};

using SampleSink = std::function<void(const scan::Vec3& place_mm, const scan::Vec3& normal)>;
/// About `points` samples with exact normals about the origin, one after another: as many as there is room for. The
/// same every time: seeded.
void for_each_sample(CloudKind kind, std::size_t points, const SampleSink& sink);

/// All of them, placed in the build frame.
[[nodiscard]] scan::PointCloud make_cloud(CloudKind kind, std::size_t points);

}  // namespace telefab::bench
