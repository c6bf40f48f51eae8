// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <span>
#include <string>
#include <telefab/image/frame.hpp>
#include <telefab/scan/cloud/point_cloud.hpp>
#include <telefab/scan/placing/turn.hpp>
#include <vector>

namespace telefab::scan {

/// A way to stand, and the lines that are written below its picture; the first is the heading.
struct StandingTile {
  Turn turn;
  std::vector<std::string> lines;
};

/// The object as it would stand, once for each tile, from in front and a little below, on the line of
/// the platform; all equally large. Undersides so flat that supports have to hold them are orange. `cloud` has normals;
/// one that is mirrored is drawn mirrored. `caption` says whose picture it is; legend and axes are filled in. RGB.
[[nodiscard]] Image draw_standings(const PointCloud& cloud, std::span<const StandingTile> tiles,
                                   PictureCaption caption);

}  // namespace telefab::scan
