// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <cstdint>
#include <span>
#include <telefab/machine/machine_profile.hpp>
#include <vector>

namespace telefab::fab {

/// Grey levels of one exposure, row-major, 0 dark .. 255 full. Seen as a picture a mask is the layer from above: pixel
/// (column c, row r) covers x from c to c + 1 and y from height - 1 - r to height - r pitches of the build frame, so a
/// platform that is no whole number of pixels deep keeps its rest at the back. What the optics mirror is applied by the
/// projector's driver, never here.
struct MaskView {
  PixelSize size;
  std::span<const std::uint8_t> rows;
};

struct Mask {
  PixelSize size;
  std::vector<std::uint8_t> rows;
  [[nodiscard]] MaskView view() const { return {size, rows}; }
  friend bool operator==(const Mask&, const Mask&) = default;
};

}  // namespace telefab::fab
