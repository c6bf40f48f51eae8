// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <optional>
#include <span>
#include <string>
#include <string_view>

namespace telefab {

/// The name that was meant, where a slip of the keys, a missing end or another order of the words between dashes
/// explains it; else nothing. The same slips away, the first of them counts.
[[nodiscard]] std::optional<std::string> nearest_name(std::string_view word, std::span<const std::string> names);

/// What to say behind "no X named WORD; ": what was meant where that shows, and which there are; of a long list the
/// first ones, and `lister`, what lists them all: "`telefab machines`".
[[nodiscard]] std::string names_instead(std::string_view word, std::span<const std::string> names,
                                        std::string_view lister);

}  // namespace telefab
