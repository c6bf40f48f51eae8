// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <span>
#include <telefab/fab/mask/raster.hpp>

namespace telefab::fab {

/// A point of a contour where the dose has to meet the threshold. Pixels, y from the front.
struct EdgeSpot {
  double x_px = 0;
  double y_px = 0;
  float weight = 0;  ///< length of contour it stands for, less near corners
};

struct EdgeSampling {
  double step_px = 0.5;
  double corner_weight = 0.2;
  double corner_px = 1;        ///< along the ring
  double corner_rad = 0.5236;  ///< a vertex that turns by more is a corner
};

/// Equally spaced spots of every ring, in the order of the rings.
[[nodiscard]] std::vector<EdgeSpot> edge_spots(std::span<const Contour> rings, double pixel_pitch_mm,
                                               const EdgeSampling& sampling);

}  // namespace telefab::fab
