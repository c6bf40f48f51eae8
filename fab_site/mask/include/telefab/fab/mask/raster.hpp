// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <span>
#include <telefab/fab/mask/mask.hpp>
#include <telefab/geometry/contour.hpp>

namespace telefab::fab {

/// Where a mask lies in the build frame; see mask.hpp.
struct MaskFrame {
  PixelSize size;
  double pixel_pitch_mm = 0;
};
[[nodiscard]] MaskFrame mask_frame(const MachineProfile& machine);

/// The share of every pixel that lies inside the rings, as grey: round(255 * share). Exact for vertices of any
/// precision, up to the rounding of double; rings may be clipped by the mask's edges. Outer rings run
/// counter-clockwise, holes clockwise; rings must not cross, and where they overlap a pixel counts as full at most.
/// Cost: proportional to contour length in pixels, plus one pass over the rows that are touched.
[[nodiscard]] Mask rasterise(std::span<const Contour> rings, const MaskFrame& frame);

/// Adds the cover of rings to a mask, up to 255: masks of regions that do not overlap become the mask of all.
void add_cover(Mask& mask, std::span<const Contour> rings, double pixel_pitch_mm);

}  // namespace telefab::fab
