// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <cstddef>
#include <cstdint>
#include <span>
#include <telefab/base/result.hpp>
#include <vector>

namespace telefab {

/// 8-bit pixels, row-major, top row first; one channel (grey) or three (red, green, blue).
/// Invariant of what the functions here return: pixels.size() == width * height * channels.
struct Image {
  std::uint32_t width_px = 0;
  std::uint32_t height_px = 0;
  std::uint32_t channels = 1;
  std::vector<std::uint8_t> pixels;
  friend bool operator==(const Image&, const Image&) = default;
};

/// PNG (ISO/IEC 15948), 8 bits a channel, no filter. Masks and drawings are long runs and rows like the row above:
/// only these are looked for (run_deflate.hpp); other images are deflated by libdeflate at level 1. The same image
/// gives the same bytes. Fails with InvalidInput for sizes that do not fit the pixels.
[[nodiscard]] Result<std::vector<std::byte>> encode_png(const Image& image);
/// The same for grey pixels that are not in an Image.
[[nodiscard]] Result<std::vector<std::byte>> encode_png_grey(std::uint32_t width_px, std::uint32_t height_px,
                                                             std::span<const std::uint8_t> pixels);

/// Reads a PNG of any colour type as grey where it is grey, else as RGB; 16 bits become 8, transparency is dropped.
/// Fails with InvalidInput (no PNG, damaged, truncated), TooLarge (more than max_pixels, before memory is taken).
[[nodiscard]] Result<Image> decode_png(std::span<const std::byte> bytes, std::uint64_t max_pixels);

}  // namespace telefab
