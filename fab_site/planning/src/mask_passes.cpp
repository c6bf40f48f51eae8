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

}  // namespace telefab::fab
