// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <cstdint>
#include <string_view>
#include <vector>

namespace telefab {

/// A point of an outline, in thousandths of the em, y up.
struct OutlinePoint {
  std::int16_t x = 0;
  std::int16_t y = 0;
};

/// One character: rings of which an odd number surrounds what is filled.
struct Glyph {
  int advance = 0;  ///< from its origin to that of the next one, in thousandths of the em
  std::vector<std::vector<OutlinePoint>> rings;
};

/// Height of capitals, in thousandths of the em.
inline constexpr double kCapHeight = 729;

/// The glyphs of a text, left to right. What is not UTF-8, and what would steer a terminal, shows as '?'; a character
/// the font has not (it has Latin, Greek and Cyrillic ones) as the replacement character.
[[nodiscard]] std::vector<const Glyph*> glyphs_of(std::string_view text);

/// The file font/outlines.txt.
[[nodiscard]] std::string_view font_outlines();

}  // namespace telefab
