// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <cstdint>
#include <telefab/fab/mask/mask.hpp>

namespace telefab::test {

/// What the guest shows and the test outside expects.
inline fab::Mask guest_pattern(PixelSize size, std::uint32_t k) {
  fab::Mask mask{size, std::vector<std::uint8_t>(std::size_t{size.width_px} * size.height_px)};
  for (std::uint32_t y = 0; y < size.height_px; ++y)
    for (std::uint32_t x = 0; x < size.width_px; ++x)
      mask.rows[std::size_t{y} * size.width_px + x] = static_cast<std::uint8_t>(x * 7 + y * 13 + k * 29);
  return mask;
}

}  // namespace telefab::test
