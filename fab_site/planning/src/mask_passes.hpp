// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <cstdint>
#include <span>
#include <telefab/fab/mask/mask.hpp>
#include <telefab/fab/verify/layer_runs.hpp>

namespace telefab::fab {

/// Passes over whole masks, compiled for speed.

struct GreySums {
  std::uint64_t grey = 0;   ///< all levels added up
  std::uint64_t white = 0;  ///< pixels of 255
};
[[nodiscard]] GreySums sums_of(std::span<const std::uint8_t> greys);

/// 255 for what is `level` or above, else 0.
void keep_from(std::uint8_t level, std::span<std::uint8_t> greys);

/// Black for some pixels of what is solid and for those around them that belong to nothing else solid.
void darken(Mask& mask, const LayerRuns& specks, const LayerRuns& solid);

}  // namespace telefab::fab
