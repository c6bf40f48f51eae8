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

/// Adds grey levels, at most 255: two masks of regions that do not overlap become the mask of both.
/// Both must have the same size.
[[nodiscard]] Mask merged(Mask mask, const Mask& other);

/// Some pixels in a row of one layer.
struct PixelRun {
  std::uint32_t row = 0;
  std::uint32_t first = 0;
  std::uint32_t end = 0;  ///< one behind the last
  friend bool operator==(const PixelRun&, const PixelRun&) = default;
};
/// The runs of pixels at or above `threshold`, by row, then column.
[[nodiscard]] std::vector<PixelRun> cured_runs(const Mask& mask, std::uint8_t threshold);

/// A patch of a layer that touches nothing below it.
struct Island {
  std::uint64_t area_px = 0;
  double x_px = 0;  ///< centre, columns from the left
  double y_px = 0;  ///< centre, rows from the top
};
/// Connected patches (8 neighbours) of `runs` that share no pixel with `below`, of at least `min_area_px` pixels, by
/// place of their first pixel. Both lists as cured_runs gives them.
[[nodiscard]] std::vector<Island> unsupported_islands(std::span<const PixelRun> runs, std::span<const PixelRun> below,
                                                      std::uint64_t min_area_px);

}  // namespace telefab::fab
