// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

namespace telefab {

/// The name that was meant, where a slip of the keys or a missing end explains the word; else nothing. The same slips
/// away, the first of them counts.
[[nodiscard]] std::optional<std::string> meant(std::string_view word, std::span<const std::string> names);

/// What is wrong with a command line, in the words of whoever wrote it.
[[nodiscard]] std::string unknown_verb(std::string_view program, std::string_view word,
                                       std::span<const std::string> verbs);
/// `options` and `word` with their dashes; a word without is one that the verb has no place for.
[[nodiscard]] std::string unexpected_word(std::string_view word, std::span<const std::string> options);
/// For an option that stands where the verb belongs.
[[nodiscard]] std::string option_before_verb(std::string_view program, std::string_view option);
/// A number with a decimal comma among the words, with what to write instead.
[[nodiscard]] std::optional<std::string> decimal_comma(std::span<const std::string> words);

}  // namespace telefab
