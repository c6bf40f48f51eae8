// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <telefab/fab/mask/mask.hpp>
#include <vector>

namespace telefab::fab {

/// A mask that waits: as runs of equal greys, since most of it is black or white; as it is where runs would need more.
class PackedMask {
 public:
  PackedMask() = default;
  explicit PackedMask(const Mask& mask);
  [[nodiscard]] Mask unpacked() const;
  [[nodiscard]] std::size_t bytes() const { return runs_.size() * sizeof(std::uint32_t) + rows_.size(); }

 private:
  PixelSize size_;
  std::vector<std::uint32_t> runs_;  ///< length * 256 + grey, row by row
  std::vector<std::uint8_t> rows_;   ///< empty, or the mask as it is
};

}  // namespace telefab::fab
