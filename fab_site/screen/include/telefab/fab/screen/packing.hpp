// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <array>
#include <cstddef>
#include <cstdint>
#include <span>
#include <telefab/base/result.hpp>
#include <telefab/fab/mask/mask.hpp>

namespace telefab::fab {

/// How the words that a screen scans out are the pixels of the panel behind it.
struct PanelLayout {
  PixelSize words;  ///< of the mode: words across, rows
  PixelPacking packing = PixelPacking::Grey;
  OpticsTurn optics = OpticsTurn::Normal;  ///< first, what the optics do to a mask
  ScreenTurn turn = ScreenTurn::None;      ///< then how the panel stands
  friend bool operator==(const PanelLayout&, const PanelLayout&) = default;
};

/// 1 or 3.
[[nodiscard]] std::uint32_t pixels_per_word(PixelPacking packing);
/// 4 or 2; the low byte first.
[[nodiscard]] std::uint32_t bytes_per_word(PixelPacking packing);
/// Of the panel itself.
[[nodiscard]] PixelSize panel_pixels(const PanelLayout& layout);
/// Greys from dark to full of the 256 that each pixel of a word keeps, the first pixel first. A pixel of fewer gets the
/// nearest one, so that dark and full stay what they are.
[[nodiscard]] std::array<std::uint32_t, 3> greys_of(PixelPacking packing);

/// Fails with InvalidInput, and says both sizes, where a mask of that size, turned, is larger than the panel, or its
/// width is not whole words: pixels are neither dropped nor added.
[[nodiscard]] Result<void> check_fits(PixelSize mask, const PanelLayout& layout);

/// The words that show the mask, centred and dark around: mirrored and turned pixel by pixel, and packed after that,
/// for a mirrored word is another one. `out` is words.height_px rows of `pitch_bytes`; what lies behind a row's words
/// is not written. Fails as check_fits, and with InvalidInput where out or mask have another size than they say.
/// Cost: one pass; 8K in one word a pixel or in three is 10 to 50 ms of one core.
[[nodiscard]] Result<void> pack_mask(const MaskView& mask, const PanelLayout& layout, std::span<std::byte> out,
                                     std::size_t pitch_bytes);

}  // namespace telefab::fab
