#pragma once
#include <cstdint>
#include <span>

namespace telefab::fab {

/// Passes over whole masks, compiled for speed.

struct GreySums {
  std::uint64_t grey = 0;   ///< all levels added up
  std::uint64_t white = 0;  ///< pixels of 255
};
[[nodiscard]] GreySums sums_of(std::span<const std::uint8_t> greys);

/// 255 for what is `level` or above, else 0.
void keep_from(std::uint8_t level, std::span<std::uint8_t> greys);

}  // namespace telefab::fab
