// SPDX-License-Identifier: GPL-3.0-or-later
#include <algorithm>
#include <telefab/fab/mask/orientation.hpp>

namespace telefab::fab {

Orientation orientation_of(OpticsTurn turn) {
  switch (turn) {
    case OpticsTurn::Normal:
      return {};
    case OpticsTurn::MirrorX:
      return {true, false};
    case OpticsTurn::MirrorY:
      return {false, true};
    case OpticsTurn::Rotate180:
      return {true, true};
  }
  return {};
}

Mask turned_for_optics(const MaskView& mask, Orientation optics) {
  const std::size_t width = mask.size.width_px;
  Mask out{mask.size, std::vector<std::uint8_t>(mask.rows.size())};
  for (std::uint32_t y = 0; y < mask.size.height_px; ++y) {
    const auto row = mask.rows.subspan((optics.mirrors_y ? mask.size.height_px - 1 - y : y) * width, width);
    const auto to = out.rows.begin() + static_cast<std::ptrdiff_t>(y * width);
    if (optics.mirrors_x)
      std::reverse_copy(row.begin(), row.end(), to);
    else
      std::copy(row.begin(), row.end(), to);
  }
  return out;
}

std::array<Mask, 2> halves_of(const MaskView& mask) {
  const std::uint32_t half = mask.size.width_px / 2;
  std::array<Mask, 2> halves;
  for (Mask& m : halves) {
    m.size = {half, mask.size.height_px};
    m.rows.reserve(std::size_t{half} * mask.size.height_px);
  }
  for (std::uint32_t y = 0; y < mask.size.height_px; ++y)
    for (std::size_t i = 0; i < 2; ++i) {
      const auto row = mask.rows.subspan(std::size_t{y} * mask.size.width_px + i * half, half);
      halves[i].rows.insert(halves[i].rows.end(), row.begin(), row.end());
    }
  return halves;
}

}  // namespace telefab::fab
