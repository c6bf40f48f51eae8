// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <charconv>
#include <cmath>
#include <optional>
#include <string_view>

namespace telefab::fab {

/// Takes a finite decimal number off the front, nothing (and nothing taken) where there is none. The locale has no say.
[[nodiscard]] inline std::optional<double> take_number(std::string_view& text) {
  std::string_view rest = text;
  if (rest.starts_with('+')) rest.remove_prefix(1);
  double value = 0;
  const auto [end, error] = std::from_chars(rest.data(), rest.data() + rest.size(), value);
  if (error != std::errc{} || !std::isfinite(value)) return std::nullopt;
  rest.remove_prefix(static_cast<std::size_t>(end - rest.data()));
  text = rest;
  return value;
}

inline bool is_space(char c) { return c == ' ' || c == '\t' || c == '\n' || c == '\r'; }

inline void skip_space(std::string_view& text) {
  std::size_t count = 0;
  while (count < text.size() && is_space(text[count])) ++count;
  text.remove_prefix(count);
}

/// All of the text is one number.
[[nodiscard]] inline std::optional<double> whole_number_text(std::string_view text) {
  skip_space(text);
  const auto value = take_number(text);
  skip_space(text);
  return value && text.empty() ? value : std::nullopt;
}

}  // namespace telefab::fab
