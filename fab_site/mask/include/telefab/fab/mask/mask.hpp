#pragma once
#include <cstdint>
#include <span>
#include <telefab/machine/machine_profile.hpp>
#include <vector>

namespace telefab::fab {

/// Grey levels of one exposure, row-major, 0 dark .. 255 full. Row 0 is the back of the platform (largest y), column
/// 0 its left (x = 0), so that a mask viewed as a picture is the layer seen from above. What the optics mirror is
/// applied by the projector's driver, never here.
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
