// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <algorithm>
#include <cstdint>
#include <telefab/fab/mask/mask.hpp>

namespace telefab::fab {

/// How many masks of a size may be under way at once, at least one and at most `most`: large ones do not fill the
/// memory.
[[nodiscard]] inline std::uint32_t masks_at_once(PixelSize size, std::uint32_t most) {
  constexpr std::uint64_t kBudgetBytes = 320U << 20U;
  constexpr std::uint64_t kCopies = 3;  // the mask, its PNG before and after it is deflated; or its runs and its rings
  const std::uint64_t bytes = kCopies * size.width_px * size.height_px;
  return static_cast<std::uint32_t>(std::clamp<std::uint64_t>(kBudgetBytes / bytes, 1, most));
}

}  // namespace telefab::fab
