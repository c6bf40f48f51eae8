// SPDX-License-Identifier: GPL-3.0-or-later
#include <telefab/base/person_name.hpp>
#include <telefab/base/text.hpp>

#include <cstddef>
#include <cstdint>

namespace telefab {
namespace {

/// The first character of a text: its bytes, and its code point where they are well-formed.
struct Character {
  std::size_t bytes = 1;
  std::uint32_t code = 0;
  bool well_formed = false;
};

/// `text` is not empty. Of a broken sequence one byte is taken (Unicode 3.9, table 3-7).
Character first_of(std::string_view text) {
  const auto byte = [&](std::size_t i) { return static_cast<unsigned char>(text[i]); };
  const unsigned char lead = byte(0);
  if (lead < 0x80) return {1, lead, true};
  const std::size_t bytes = lead >= 0xF0 ? 4 : lead >= 0xE0 ? 3 : 2;
  if (lead < 0xC2 || lead > 0xF4 || text.size() < bytes) return {};
  std::uint32_t code = lead & (0xFFU >> (bytes + 1));
  for (std::size_t i = 1; i < bytes; ++i) {
    if ((byte(i) & 0xC0U) != 0x80U) return {};
    code = code << 6U | (byte(i) & 0x3FU);
  }
  const bool overlong = (bytes == 3 && code < 0x800) || (bytes == 4 && code < 0x10000);
  const bool surrogate = code >= 0xD800 && code <= 0xDFFF;
  if (overlong || surrogate || code > 0x10FFFF) return {};
  return {bytes, code, true};
}

bool shows(const Character& c) {
  if (!c.well_formed) return false;
  const bool control = c.code < 0x20 || (c.code >= 0x7F && c.code < 0xA0);
  const bool separator = c.code == 0x2028 || c.code == 0x2029;
  const bool reorders = c.code == 0x061C || c.code == 0x200E || c.code == 0x200F ||
                        (c.code >= 0x202A && c.code <= 0x202E) || (c.code >= 0x2066 && c.code <= 0x2069);
  return !control && !separator && !reorders;
}

/// Beyond ASCII: what scripts write words with, by blocks of Unicode. Left out are its spaces, marks and symbols
/// (U+2000 to U+2BFF, U+3000 to U+303F), forms that are not seen (U+FE00 to U+FEFF, U+FFF0 on, tags), private use.
bool is_letter_beyond_ascii(std::uint32_t code) {
  if (code == 0xD7 || code == 0xF7) return false;  // times and divided by
  return (code >= 0xC0 && code < 0x2000) || (code >= 0x2C00 && code < 0x3000) || (code >= 0x3040 && code < 0xD800) ||
         (code >= 0xF900 && code < 0xFE00) || (code >= 0x20000 && code < 0x40000);
}

}  // namespace

bool is_printable(std::string_view text) {
  while (!text.empty()) {
    const Character c = first_of(text);
    if (!shows(c)) return false;
    text.remove_prefix(c.bytes);
  }
  return true;
}

std::string to_printable(std::string_view text) {
  std::string out;
  out.reserve(text.size());
  while (!text.empty()) {
    const Character c = first_of(text);
    if (shows(c))
      out += text.substr(0, c.bytes);
    else
      out += c.code == '\n' || c.code == '\r' || c.code == '\t' ? ' ' : '?';
    text.remove_prefix(c.bytes);
  }
  return out;
}

bool is_person_name(std::string_view text, std::string_view marks, std::size_t most_bytes) {
  if (text.empty() || text.size() > most_bytes) return false;
  while (!text.empty()) {
    const Character c = first_of(text);
    const bool is_ascii_word = (c.code >= 'a' && c.code <= 'z') || (c.code >= 'A' && c.code <= 'Z') ||
                               (c.code >= '0' && c.code <= '9') ||
                               (c.code < 0x80 && marks.find(static_cast<char>(c.code)) != std::string_view::npos);
    if (!shows(c) || !(is_ascii_word || is_letter_beyond_ascii(c.code))) return false;
    text.remove_prefix(c.bytes);
  }
  return true;
}

bool is_file_name(std::string_view text) {
  constexpr std::size_t kMostBytes = 255;  // what file systems take
  return !text.empty() && text.size() <= kMostBytes && text.front() != '.' && is_printable(text) &&
         text.find_first_of("/\\") == std::string_view::npos;
}

}  // namespace telefab
