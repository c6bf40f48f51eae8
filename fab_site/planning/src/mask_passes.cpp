// SPDX-License-Identifier: GPL-3.0-or-later
#include "mask_passes.hpp"

#include <algorithm>

namespace telefab::fab {

GreySums sums_of(std::span<const std::uint8_t> greys) {
  constexpr std::size_t kPiece = 1U << 16U;  // so that 32 bits hold its sum
  GreySums sums;
  for (std::size_t from = 0; from < greys.size(); from += kPiece) {
    std::uint32_t grey = 0, white = 0;
    for (const std::uint8_t level : greys.subspan(from, std::min(kPiece, greys.size() - from))) {
      grey += level;
      white += level == 255;
    }
    sums.grey += grey;
    sums.white += white;
  }
  return sums;
}

void keep_from(std::uint8_t level, std::span<std::uint8_t> greys) {
  for (std::uint8_t& grey : greys) grey = grey >= level ? 255 : 0;
}

void darken(Mask& mask, const LayerRuns& specks, const LayerRuns& solid) {
  const auto width = static_cast<std::int32_t>(mask.size.width_px),
             height = static_cast<std::int32_t>(mask.size.height_px);
  for (std::int32_t y = 0; y < height; ++y)
    for (const PixelRun& run : specks.row(static_cast<std::uint32_t>(y)))
      for (std::int32_t j = std::max(0, y - 1); j <= std::min(height - 1, y + 1); ++j)
        for (std::int32_t i = std::max(0, run.first - 1); i < std::min(width, run.behind + 1); ++i) {
          const auto row = static_cast<std::uint32_t>(j);
          if (solid.contains(i, row) && !specks.contains(i, row)) continue;
          mask.rows[static_cast<std::size_t>(height - 1 - j) * mask.size.width_px + static_cast<std::size_t>(i)] = 0;
        }
}

}  // namespace telefab::fab
