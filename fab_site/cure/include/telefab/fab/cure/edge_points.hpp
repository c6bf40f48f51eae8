// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <telefab/fab/cure/dose_field.hpp>

namespace telefab::fab {

/// Where the edge of what reaches a dose crosses a line of a regular lattice.
struct EdgePoint {
  PixelPlace place;
  double normal_x = 0;  ///< outwards, to less dose; unit length
  double normal_y = 0;
  double steepness = 0;     ///< fall of ln(dose) per pixel along the normal
  bool on_upright = false;  ///< the line it lies on runs along y
};

/// All crossings of the level set `dose == threshold` with lines along x and y, `lines_per_px` (1 to 16) a pixel,
/// searched at steps of 1 / sub_pixels and refined on the exact field (to some 1e-5 px). Edges that leave and come back
/// between two steps are missed. Order: by tile, line, place. Same points on any number of threads.
[[nodiscard]] std::vector<EdgePoint> edge_points(const DoseField& dose, double threshold, int sub_pixels,
                                                 int lines_per_px);

}  // namespace telefab::fab
