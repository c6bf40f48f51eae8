// SPDX-License-Identifier: GPL-3.0-or-later
#include "lzf.hpp"

#include <cstdint>

namespace telefab::scan {

std::optional<std::vector<std::byte>> expand_lzf(std::span<const std::byte> packed, std::size_t size) {
  constexpr std::size_t kMaxGain = 264;
  if (size / kMaxGain > packed.size()) return std::nullopt;
  std::vector<std::byte> out;
  out.reserve(size);
  for (std::size_t at = 0; at < packed.size();) {
    const unsigned control = std::to_integer<unsigned>(packed[at++]);
    if (control < 32) {
      const std::size_t length = control + 1;
      if (length > packed.size() - at || length > size - out.size()) return std::nullopt;
      out.insert(out.end(), packed.begin() + static_cast<std::ptrdiff_t>(at),
                 packed.begin() + static_cast<std::ptrdiff_t>(at + length));
      at += length;
      continue;
    }
    std::size_t length = control >> 5U;
    if (length == 7) {
      if (at == packed.size()) return std::nullopt;
      length += std::to_integer<std::size_t>(packed[at++]);
    }
    length += 2;
    if (at == packed.size()) return std::nullopt;
    const std::size_t distance = ((control & 31U) << 8U) + std::to_integer<std::size_t>(packed[at++]) + 1;
    if (distance > out.size() || length > size - out.size()) return std::nullopt;
    for (std::size_t from = out.size() - distance; length > 0; --length, ++from) {
      const std::byte copied = out[from];
      out.push_back(copied);
    }
  }
  if (out.size() != size) return std::nullopt;
  return out;
}

}  // namespace telefab::scan
