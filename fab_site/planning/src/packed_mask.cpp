// SPDX-License-Identifier: GPL-3.0-or-later
#include "packed_mask.hpp"

#include <algorithm>
#include <span>

namespace telefab::fab {
namespace {

constexpr std::uint32_t kLongest = (1U << 24U) - 1;

/// How many greys from the first on are equal to it; at least one is there.
std::size_t run_of(std::span<const std::uint8_t> greys) {
  constexpr std::size_t kBlock = 32;  // no branch within it
  std::size_t end = 1;
  for (; end + kBlock <= greys.size(); end += kBlock) {
    std::uint8_t differs = 0;
    for (std::size_t i = 0; i < kBlock; ++i) differs |= static_cast<std::uint8_t>(greys[end + i] ^ greys[0]);
    if (differs != 0) break;
  }
  while (end < greys.size() && greys[end] == greys[0]) ++end;
  return end;
}

}  // namespace

PackedMask::PackedMask(const Mask& mask) : size_{mask.size} {
  const std::size_t most = mask.rows.size() / sizeof(std::uint32_t);
  for (auto at = mask.rows.begin(); at != mask.rows.end();) {
    const auto limit = at + std::min<std::ptrdiff_t>(kLongest, mask.rows.end() - at);
    const auto end = at + static_cast<std::ptrdiff_t>(run_of({&*at, static_cast<std::size_t>(limit - at)}));
    runs_.push_back((static_cast<std::uint32_t>(end - at) << 8U) | *at);
    if (runs_.size() > most) {
      runs_ = {};
      rows_ = mask.rows;
      return;
    }
    at = end;
  }
  runs_.shrink_to_fit();
}

Mask PackedMask::unpacked() const {
  if (!rows_.empty()) return {size_, rows_};
  Mask mask{size_, {}};
  mask.rows.reserve(std::size_t{size_.width_px} * size_.height_px);
  for (const std::uint32_t run : runs_) mask.rows.insert(mask.rows.end(), run >> 8U, static_cast<std::uint8_t>(run));
  return mask;
}

}  // namespace telefab::fab
