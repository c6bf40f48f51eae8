// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <cstdint>
#include <span>
#include <telefab/image/png.hpp>
#include <telefab/scan/cloud/point_cloud.hpp>
#include <telefab/scan/formats/write_cloud.hpp>

namespace telefab::scan {

struct PictureOptions {
  std::uint32_t side_px = 480;  ///< [64, 4096]; of each of the four views
  int splat_px = 0;             ///< [0, 8]; half side of a point's square, 0 = from the density
};

/// Points seen from front, right, back and above (parallel projection, z up), side by side in two rows, nearer points
/// hide farther ones; shaded where the cloud has normals. `colours` has one a point. White background.
[[nodiscard]] Image draw_points(const PointCloud& cloud, std::span<const PointColour> colours,
                                const PictureOptions& options);

}  // namespace telefab::scan
