// SPDX-License-Identifier: GPL-3.0-or-later
#include "usage_error.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <charconv>
#include <cmath>
#include <regex>
#include <telefab/base/nearest_name.hpp>

namespace telefab {

std::string unknown_verb(std::string_view program, std::string_view word, std::span<const std::string> verbs) {
  if (const auto verb = nearest_name(word, verbs))
    return fmt::format("there is no verb '{}'; did you mean '{}'?", word, *verb);
  return fmt::format("there is no verb '{}'; the first word says what to do: {} VERB ...; there are: {}", word, program,
                     fmt::join(verbs, ", "));
}

std::string unexpected_word(std::string_view word, std::span<const std::string> options) {
  if (!word.starts_with('-'))
    return fmt::format("'{}' is one word too many; a name with blanks stands in quotes", word);
  const std::string_view name = word.substr(0, word.find('='));
  if (const auto option = nearest_name(name, options))
    return fmt::format("there is no option {}; did you mean {}?", name, *option);
  return fmt::format("there is no option {}", name);
}

std::string option_before_verb(std::string_view program, std::string_view option) {
  return fmt::format("options stand behind the verb: {} VERB {}", program, option);
}

std::string no_verb(std::string_view program, std::span<const std::string> verbs) {
  return fmt::format("say what to do: {} VERB; there are: {}", program, fmt::join(verbs, ", "));
}

std::string no_value(std::string_view option, std::string_view value) {
  return fmt::format("{0} needs a value behind it: {0} {1}", option, value);
}

std::string no_such_choice(std::string_view word, std::span<const std::string> choices) {
  const auto meant = nearest_name(word, choices);
  return fmt::format("{} is none of {}{}", word, fmt::join(choices, ", "),
                     meant ? fmt::format("; did you mean {}?", *meant) : "");
}

std::string number_problem(std::string_view word, NumberKind kind) {
  const std::string_view digits = word.substr(word.starts_with('+') ? 1 : 0);
  double value = 0;
  const auto [end, error] = std::from_chars(digits.data(), digits.data() + digits.size(), value);
  const std::string_view rest{end, static_cast<std::size_t>(digits.data() + digits.size() - end)};
  const bool is_number = error == std::errc{} && std::isfinite(value);
  if (is_number && rest.empty()) {
    if (kind == NumberKind::Any) return {};
    // "010" would be read as the octal number that it is in C.
    const bool is_octal = digits.size() > 1 && digits[digits.starts_with('-') ? 1 : 0] == '0' && std::abs(value) >= 1;
    const bool is_whole = digits.find_first_not_of("-0123456789") == std::string_view::npos && !is_octal;
    if (is_whole && (kind == NumberKind::Whole || !digits.starts_with('-'))) return {};
    return fmt::format("{} is not a whole number{}{}", word, kind == NumberKind::Counting ? " from 0 on" : "",
                       is_octal ? "; leave out the 0 at its front" : "");
  }
  static const std::regex comma{R"([+-]?(\d*),(\d+))"};
  if (std::cmatch found; std::regex_match(word.data(), word.data() + word.size(), found, comma))
    return fmt::format("{} is not a number: write {}.{}, with a point", word, word.substr(0, word.find(',')),
                       found[2].str());
  // "0x10" in C, and in no program's figures: its beginning is no number with a unit behind it.
  static const std::regex prefixed{R"([+-]?0[xXbBoO][0-9a-fA-F.]*)"};
  if (std::regex_match(word.begin(), word.end(), prefixed))
    return fmt::format("{} is not a number: write it in decimal digits", word);
  if (is_number)
    return fmt::format("{} is not a number: leave out \"{}\", the unit stands in the option's name", word, rest);
  return fmt::format("{} is not a number", word.empty() ? "nothing" : word);
}

}  // namespace telefab
