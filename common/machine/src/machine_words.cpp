// SPDX-License-Identifier: GPL-3.0-or-later
#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <telefab/machine/machine_words.hpp>

namespace telefab {

Result<std::size_t> place_among(std::string_view name, std::span<const std::string_view> words) {
  const auto found = std::ranges::find(words, name);
  if (found != words.end()) return static_cast<std::size_t>(found - words.begin());
  return fail(ErrorCode::InvalidInput, fmt::format("\"{}\" is not known; there are: {}", name, fmt::join(words, ", ")));
}

}  // namespace telefab
