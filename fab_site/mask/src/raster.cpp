#include <algorithm>
#include <telefab/fab/mask/raster.hpp>

#include "cover_cells.hpp"

namespace telefab::fab {

MaskFrame mask_frame(const MachineProfile& machine) { return {machine.mask_size(), machine.projection.pixel_pitch_mm}; }

Mask rasterise(std::span<const Contour> rings, const MaskFrame& frame) {
  const CoverCells cells{rings, frame};
  Mask mask{frame.size, std::vector<std::uint8_t>(std::size_t{frame.size.width_px} * frame.size.height_px)};
  for (std::uint32_t y = 0; y < frame.size.height_px; ++y)
    if (!cells.empty(y))
      cells.fill(y, mask.rows.data() + std::size_t{frame.size.height_px - 1 - y} * frame.size.width_px);
  return mask;
}

Mask merged(Mask mask, const Mask& other) {
  for (std::size_t i = 0; i < mask.rows.size(); ++i)
    mask.rows[i] = static_cast<std::uint8_t>(std::min(255, mask.rows[i] + other.rows[i]));
  return mask;
}

}  // namespace telefab::fab
