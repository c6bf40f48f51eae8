// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <concepts>
#include <cstdint>
#include <limits>
#include <string>
#include <utility>

namespace telefab {

/// The whole number that a JSON value is. nlohmann's get<int>() casts whatever number stands there: 8e51 is undefined
/// behaviour, -1 becomes four billion. `Json` is its basic_json, not named here. Throws Json::other_error where the
/// value is anything else than a whole number within `least` and `most`; callers catch it with what else the parsing
/// of theirs throws.
template <std::integral Integer, class Json>
[[nodiscard]] Integer whole_number(const Json& value, Integer least = std::numeric_limits<Integer>::min(),
                                   Integer most = std::numeric_limits<Integer>::max()) {
  const auto fits = [&](auto number) {
    return std::cmp_greater_equal(number, least) && std::cmp_less_equal(number, most);
  };
  if (value.is_number_unsigned()) {
    const auto number = value.template get<std::uint64_t>();
    if (fits(number)) return static_cast<Integer>(number);
  } else if (value.is_number_integer()) {
    const auto number = value.template get<std::int64_t>();
    if (fits(number)) return static_cast<Integer>(number);
  }
  throw Json::other_error::create(
      501, "a whole number from " + std::to_string(least) + " to " + std::to_string(most) + " is expected", nullptr);
}

}  // namespace telefab
