// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <cstddef>
#include <cstdint>
#include <span>
#include <telefab/base/result.hpp>
#include <telefab/fab/mask/mask.hpp>
#include <vector>

namespace telefab::fab {

// The DLPC900's 24-bit image with enhanced run-length coding (DLPU018F 2.4.2). A grey byte stands in all three colour
// bytes, so any of them is an 8-bit pattern of the mask.

inline constexpr std::size_t kSplashHeaderBytes = 48;

/// Appends a run length: one byte below 128, else two: (n & 127) | 128, n >> 7. n <= 32767.
void append_count(std::vector<std::byte>& out, std::uint32_t n);

/// Header and coded rows of the mask, padded to four bytes. Cost: some 5 ms for a usual 1080p mask, 50 ms at worst.
[[nodiscard]] std::vector<std::byte> encode_dlpc900_image(const MaskView& mask);

/// The mask of a coded image: the device model's half, strict. Fails with InvalidInput: header, a run past the image,
/// a copy without a row above, a colour that is not grey, bytes missing or left over.
[[nodiscard]] Result<Mask> decode_dlpc900_image(std::span<const std::byte> image);

}  // namespace telefab::fab
