// SPDX-License-Identifier: GPL-3.0-or-later
#include <cstdint>
#include <cstdlib>
#include <telefab/image/png.hpp>

// A picture: an error, or as many pixels as its size says, which are encoded and decoded without a change.
extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace telefab;
  constexpr std::uint64_t kMaxPixels = 1U << 20U;
  const auto image = decode_png({reinterpret_cast<const std::byte*>(data), size}, kMaxPixels);
  if (!image) {
    if (image.error().what.empty()) std::abort();
    return 0;
  }
  if (image->pixels.size() != std::size_t{image->width_px} * image->height_px * image->channels ||
      std::uint64_t{image->width_px} * image->height_px > kMaxPixels)
    std::abort();
  const auto bytes = encode_png(*image);
  if (!bytes) std::abort();
  const auto again = decode_png(*bytes, kMaxPixels);
  if (!again || again->pixels != image->pixels) std::abort();
  return 0;
}
