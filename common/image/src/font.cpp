// SPDX-License-Identifier: GPL-3.0-or-later
#include "font.hpp"

#include <algorithm>
#include <charconv>
#include <map>
#include <string>
#include <telefab/base/text.hpp>

namespace telefab {
namespace {

constexpr std::uint32_t kReplacement = 0xFFFD;

/// Reads our own text, which is part of the program: what it lacks shows in the test that draws every character.
class OutlineReader {
 public:
  explicit OutlineReader(std::string_view line) : at_{line.data()}, end_{line.data() + line.size()} {}
  int number(int base = 10) {
    int value = 0;
    at_ = std::from_chars(at_, end_, value, base).ptr;
    return value;
  }
  /// The mark behind a number; 0 at the end.
  char mark() { return at_ == end_ ? '\0' : *at_++; }

 private:
  const char* at_;
  const char* end_;
};

Glyph glyph_from(OutlineReader& line) {
  Glyph glyph;
  glyph.advance = line.number();
  for (char mark = line.mark(); mark != '\0';) {
    auto& ring = glyph.rings.emplace_back();
    do {
      const int x = line.number();
      (void)line.mark();
      const int y = line.number();
      ring.push_back({static_cast<std::int16_t>(x), static_cast<std::int16_t>(y)});
      mark = line.mark();
    } while (mark == ' ');
  }
  return glyph;
}

using Font = std::map<std::uint32_t, Glyph>;

const Font& font() {
  static const Font read = [] {
    Font glyphs;
    std::string_view rest = font_outlines();
    while (!rest.empty()) {
      const std::size_t end = std::min(rest.find('\n'), rest.size());
      if (end > 0) {
        OutlineReader line{rest.substr(0, end)};
        const auto code = static_cast<std::uint32_t>(line.number(16));
        (void)line.mark();
        glyphs.emplace(code, glyph_from(line));
      }
      rest.remove_prefix(std::min(end + 1, rest.size()));
    }
    return glyphs;
  }();
  return read;
}

/// The first character of UTF-8 that holds; takes it off the text.
std::uint32_t take_character(std::string_view& text) {
  const auto byte = [&](std::size_t i) { return static_cast<unsigned char>(text[i]); };
  const std::size_t bytes = byte(0) < 0x80 ? 1 : byte(0) >= 0xF0 ? 4 : byte(0) >= 0xE0 ? 3 : 2;
  std::uint32_t code = bytes == 1 ? byte(0) : byte(0) & (0xFFU >> (bytes + 1));
  for (std::size_t i = 1; i < bytes; ++i) code = code << 6U | (byte(i) & 0x3FU);
  text.remove_prefix(bytes);
  return code;
}

}  // namespace

std::vector<const Glyph*> glyphs_of(std::string_view text) {
  const std::string printable = to_printable(text);
  std::vector<const Glyph*> glyphs;
  for (std::string_view rest = printable; !rest.empty();) {
    const auto known = font().find(take_character(rest));
    glyphs.push_back(known != font().end() ? &known->second : &font().at(kReplacement));
  }
  return glyphs;
}

}  // namespace telefab
