// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <cstdint>
#include <span>
#include <string>
#include <string_view>
#include <vector>

namespace telefab {

/// What is wrong with a command line, in the words of whoever wrote it.
[[nodiscard]] std::string unknown_verb(std::string_view program, std::string_view word,
                                       std::span<const std::string> verbs);
/// `options` and `word` with their dashes; a word without is one that the verb has no place for.
[[nodiscard]] std::string unexpected_word(std::string_view word, std::span<const std::string> options);
/// For an option that stands where the verb belongs.
[[nodiscard]] std::string option_before_verb(std::string_view program, std::string_view option);
/// For a program that was called with no word at all.
[[nodiscard]] std::string no_verb(std::string_view program, std::span<const std::string> verbs);
/// For an option at whose end its value is missing.
[[nodiscard]] std::string no_value(std::string_view option, std::string_view value);
/// For a word that is none of those an option takes.
[[nodiscard]] std::string no_such_choice(std::string_view word, std::span<const std::string> choices);

enum class NumberKind : std::uint8_t { Any = 1, Whole = 2, Counting = 3 };  ///< Counting: whole, not below 0
/// What is wrong with a word that is to be such a number, with what to write instead of a decimal comma or a unit;
/// empty where it is one.
[[nodiscard]] std::string number_problem(std::string_view word, NumberKind kind);

}  // namespace telefab
