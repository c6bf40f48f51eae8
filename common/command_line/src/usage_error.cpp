// SPDX-License-Identifier: GPL-3.0-or-later
#include "usage_error.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <numeric>
#include <regex>
#include <utility>

namespace telefab {
namespace {

constexpr std::size_t kLettersASlip = 3;  ///< a word bears one slip, and one more for every so many letters

/// How many letters to put in, leave out, replace or swap with their neighbour make b of a (Damerau-Levenshtein).
std::size_t slips_between(std::string_view a, std::string_view b) {
  std::vector<std::size_t> before, last(b.size() + 1), now(b.size() + 1);
  std::iota(last.begin(), last.end(), std::size_t{0});
  for (std::size_t i = 1; i <= a.size(); ++i) {
    now[0] = i;
    for (std::size_t k = 1; k <= b.size(); ++k) {
      now[k] = std::min({last[k] + 1, now[k - 1] + 1, last[k - 1] + (a[i - 1] == b[k - 1] ? 0U : 1U)});
      if (i > 1 && k > 1 && a[i - 1] == b[k - 2] && a[i - 2] == b[k - 1]) now[k] = std::min(now[k], before[k - 2] + 1);
    }
    before = std::exchange(last, now);
  }
  return last[b.size()];
}

}  // namespace

std::optional<std::string> meant(std::string_view word, std::span<const std::string> names) {
  const std::size_t letters = word.size() - std::min(word.find_first_not_of('-'), word.size());
  if (letters == 0) return std::nullopt;
  const std::string* best = nullptr;
  std::size_t fewest = std::min(letters - 1, 1 + letters / kLettersASlip) + 1;
  for (const std::string& name : names) {
    // What lacks only its end is nearer than any slip.
    const std::size_t slips = letters > 1 && name.starts_with(word) ? 0 : slips_between(word, name);
    if (slips < fewest) {
      best = &name;
      fewest = slips;
    }
  }
  return best != nullptr ? std::optional{*best} : std::nullopt;
}

std::string unknown_verb(std::string_view program, std::string_view word, std::span<const std::string> verbs) {
  if (const auto verb = meant(word, verbs))
    return fmt::format("{} has no verb '{}'; did you mean '{}'?", program, word, *verb);
  return fmt::format("{} has no verb '{}'", program, word);
}

std::string unexpected_word(std::string_view word, std::span<const std::string> options) {
  if (!word.starts_with('-'))
    return fmt::format("'{}' is one word too many; a name with blanks stands in quotes", word);
  const std::string_view name = word.substr(0, word.find('='));
  if (const auto option = meant(name, options))
    return fmt::format("there is no option {}; did you mean {}?", name, *option);
  return fmt::format("there is no option {}", name);
}

std::string option_before_verb(std::string_view program, std::string_view option) {
  return fmt::format("options stand behind the verb: {} VERB {}", program, option);
}

std::optional<std::string> decimal_comma(std::span<const std::string> words) {
  static const std::regex comma{R"((?:.*=)?([+-]?\d+),(\d+))"};
  std::smatch found;
  for (const std::string& word : words)
    if (std::regex_match(word, found, comma))
      return fmt::format("numbers have a point, not a comma: {}.{}", found[1].str(), found[2].str());
  return std::nullopt;
}

}  // namespace telefab
