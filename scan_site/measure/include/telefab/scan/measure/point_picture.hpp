// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <cstdint>
#include <optional>
#include <span>
#include <telefab/image/frame.hpp>
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

/// The same with names of the views in the frame of all pictures. `caption` says whose picture it is and has its
/// legend; a scale bar is drawn where the cloud's unit is the millimetre (`is_mm`).
[[nodiscard]] Image framed_points(const PointCloud& cloud, std::span<const PointColour> colours, PictureCaption caption,
                                  bool is_mm, const std::optional<DeviationScale>& deviation = std::nullopt);
[[nodiscard]] PointColour point_colour(Colour colour);

}  // namespace telefab::scan
