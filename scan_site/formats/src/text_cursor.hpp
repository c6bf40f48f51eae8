// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <array>
#include <charconv>
#include <cstddef>
#include <cstring>
#include <limits>
#include <optional>
#include <span>
#include <string_view>
#include <system_error>
#include <type_traits>

namespace telefab::scan {

[[nodiscard]] inline std::string_view as_text(std::span<const std::byte> bytes) {
  return {reinterpret_cast<const char*>(bytes.data()), bytes.size()};
}

/// Walks text by line and by number, never past the end, never copying.
class TextCursor {
 public:
  explicit TextCursor(std::string_view text) : at_{text.data()}, end_{text.data() + text.size()} {}

  [[nodiscard]] bool at_end() const { return at_ == end_; }
  [[nodiscard]] std::size_t bytes_left() const { return static_cast<std::size_t>(end_ - at_); }
  [[nodiscard]] std::string_view rest() const { return {at_, bytes_left()}; }
  [[nodiscard]] std::size_t line_number() const { return line_; }  ///< of the line last taken, from 1

  /// The next line without its end ("\n" or "\r\n"); empty at the end of the text.
  std::string_view take_line() {
    if (at_ == end_) return {};
    const char* stop = static_cast<const char*>(std::memchr(at_, '\n', bytes_left()));
    std::string_view line{at_, static_cast<std::size_t>((stop ? stop : end_) - at_)};
    at_ = stop ? stop + 1 : end_;
    ++line_;
    if (!line.empty() && line.back() == '\r') line.remove_suffix(1);
    return line;
  }

  /// The next line that is neither blank nor a '#' comment; empty only at the end of the text.
  std::string_view take_full_line() {
    while (!at_end()) {
      const std::string_view line = take_line();
      const std::size_t first = line.find_first_not_of(" \t");
      if (first != std::string_view::npos && line[first] != '#') return line.substr(first);
    }
    return {};
  }

 private:
  const char* at_;
  const char* end_;
  std::size_t line_ = 0;
};

/// The end of a message about a line that has commas, where they may be what is wrong with it.
[[nodiscard]] inline std::string_view about_commas(std::string_view line) {
  return line.find(',') == std::string_view::npos ? "" : "; do its numbers have a decimal comma? Write a point";
}

/// What a comma within a number is.
enum class CommaRule {
  Mark,    ///< it parts two numbers
  Decimal  ///< "12,5" is 12.5, where the format parts numbers by blanks; a word with more commas, or a point, is parted
};

/// Takes words and numbers off the front of one piece of text. Blanks, tabs, line ends,
/// commas and semicolons part them.
class FieldCursor {
 public:
  explicit FieldCursor(std::string_view text, CommaRule commas = CommaRule::Mark)
      : at_{text.data()}, end_{text.data() + text.size()}, commas_{commas} {}

  /// A number with a decimal comma was taken.
  [[nodiscard]] bool saw_decimal_comma() const { return saw_decimal_comma_; }

  [[nodiscard]] bool at_end() {
    skip();
    return at_ == end_;
  }
  [[nodiscard]] std::string_view rest() const { return {at_, static_cast<std::size_t>(end_ - at_)}; }

  /// The next word, empty at the end.
  [[nodiscard]] std::string_view take_word() {
    skip();
    const char* from = at_;
    while (at_ != end_ && !parts(*at_)) ++at_;
    return {from, static_cast<std::size_t>(at_ - from)};
  }

  /// The next number ("nan" and "inf" are numbers); nothing if the next word is none, which then stays.
  template <class T>
  [[nodiscard]] std::optional<T> take() {
    skip();
    if constexpr (std::is_floating_point_v<T>)
      if (commas_ == CommaRule::Decimal)
        if (const auto value = take_decimal_comma()) return static_cast<T>(*value);
    const char* from = at_;
    if (from != end_ && *from == '+') ++from;
    T value{};
    const auto [stop, fault] = std::from_chars(from, end_, value);
    if (fault == std::errc::invalid_argument || stop == from || (stop != end_ && !parts(*stop))) return std::nullopt;
    if (fault == std::errc::result_out_of_range) {
      if constexpr (std::is_floating_point_v<T>)
        value = 0;  // an underflow; an overflow is caught as such below
      else
        return std::nullopt;
      if (overflows(from, stop)) value = std::numeric_limits<T>::infinity();
    }
    at_ = stop;
    return value;
  }

 private:
  static bool parts(char c) { return c == ' ' || c == '\t' || c == '\n' || c == '\r' || c == ',' || c == ';'; }
  void skip() {
    while (at_ != end_ && parts(*at_)) ++at_;
  }
  /// The next word if it is a number with one comma, between digits, and no point.
  std::optional<double> take_decimal_comma() {
    std::array<char, 64> word{};
    std::size_t size = 0, comma = 0;
    for (const char* at = at_; at != end_ && *at != ' ' && *at != '\t' && *at != '\n' && *at != '\r' && *at != ';';
         ++at, ++size) {
      if (size == word.size() || *at == '.') return std::nullopt;
      if (*at == ',' && comma != 0) return std::nullopt;
      if (*at == ',') comma = size;
      word[size] = *at == ',' ? '.' : *at;
    }
    const auto is_digit = [&](std::size_t i) { return i < size && word[i] >= '0' && word[i] <= '9'; };
    if (comma == 0 || !is_digit(comma - 1) || !is_digit(comma + 1)) return std::nullopt;
    FieldCursor with_point{{word.data(), size}};
    const auto value = with_point.take<double>();
    if (!value || !with_point.at_end()) return std::nullopt;
    at_ += size;
    saw_decimal_comma_ = true;
    return value;
  }
  static bool overflows(const char* from, const char* stop) {
    const std::string_view text{from, static_cast<std::size_t>(stop - from)};
    const std::size_t e = text.find_first_of("eE");
    return e == std::string_view::npos || e + 1 >= text.size() || text[e + 1] != '-';
  }

  const char* at_;
  const char* end_;
  CommaRule commas_;
  bool saw_decimal_comma_ = false;
};

}  // namespace telefab::scan
