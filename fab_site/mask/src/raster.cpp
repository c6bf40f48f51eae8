// SPDX-License-Identifier: GPL-3.0-or-later
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

void add_cover(Mask& mask, std::span<const Contour> rings, double pixel_pitch_mm) {
  const CoverCells cells{rings, {mask.size, pixel_pitch_mm}};
  std::vector<std::uint8_t> more(mask.size.width_px);
  for (std::uint32_t y = 0; y < mask.size.height_px; ++y) {
    if (cells.empty(y)) continue;
    cells.fill(y, more.data());
    std::uint8_t* row = mask.rows.data() + std::size_t{mask.size.height_px - 1 - y} * mask.size.width_px;
    for (std::size_t x = 0; x < more.size(); ++x) row[x] = static_cast<std::uint8_t>(std::min(255, row[x] + more[x]));
  }
}

}  // namespace telefab::fab
