// SPDX-License-Identifier: GPL-3.0-or-later
#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <numeric>
#include <telefab/base/nearest_name.hpp>
#include <utility>
#include <vector>

namespace telefab {
namespace {

constexpr std::size_t kLettersASlip = 3;  ///< a word bears one slip, and one more for every so many letters
constexpr std::size_t kMostListed = 12;   ///< names that fit a line or two

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

/// The words between dashes, sorted: "--mm-height" and "--height-mm" have the same.
std::vector<std::string_view> words_of(std::string_view name) {
  std::vector<std::string_view> words;
  while (!name.empty()) {
    const std::size_t end = std::min(name.find_first_of("-_"), name.size());
    if (end > 0) words.push_back(name.substr(0, end));
    name.remove_prefix(std::min(end + 1, name.size()));
  }
  std::ranges::sort(words);
  return words;
}

}  // namespace

std::optional<std::string> nearest_name(std::string_view word, std::span<const std::string> names) {
  const std::size_t letters = word.size() - std::min(word.find_first_not_of('-'), word.size());
  if (letters == 0) return std::nullopt;
  const auto words = words_of(word);
  const std::string* best = nullptr;
  std::size_t fewest = std::min(letters - 1, 1 + letters / kLettersASlip) + 1;
  for (const std::string& name : names) {
    // What lacks only its end, or has its words in another order, is nearer than any slip.
    const bool is_part = letters > 1 && name.starts_with(word);
    const bool is_turned = words == words_of(name);
    const std::size_t slips = is_part || is_turned ? 0 : slips_between(word, name);
    if (slips < fewest) {
      best = &name;
      fewest = slips;
    }
  }
  if (best != nullptr) return *best;
  // As a last guess the name that says less: "--machine" for "--machine-name".
  const auto has_words_to_spare = [&](const std::string& name) {
    return word.starts_with('-') == name.starts_with('-') && std::ranges::includes(words, words_of(name));
  };
  const auto shorter = std::ranges::find_if(names, has_words_to_spare);
  return shorter != names.end() ? std::optional{*shorter} : std::nullopt;
}

std::string names_instead(std::string_view word, std::span<const std::string> names, std::string_view lister) {
  if (names.empty()) return "there is none";
  const auto meant = nearest_name(word, names);
  const std::string guess = meant ? fmt::format("did you mean {}? ", *meant) : std::string{};
  if (names.size() <= kMostListed) return fmt::format("{}there are: {}", guess, fmt::join(names, ", "));
  return fmt::format("{}{} lists the {} there are{}", guess, lister, names.size(),
                     meant ? "" : fmt::format(": {} ...", fmt::join(names.first(kMostListed), ", ")));
}

}  // namespace telefab
