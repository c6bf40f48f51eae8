// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <string>
#include <string_view>
#include <telefab/fleet/fleet.hpp>

// A fleet in words and in JSON, for whoever shows it.
namespace telefab::fleet {

/// "free", "busy", "occupied", "trouble".
[[nodiscard]] std::string_view name_of(Readiness readiness);
/// "fits", "ended", "has-machine", ...
[[nodiscard]] std::string_view name_of(WhyNot why);
/// For people: what is against it, with the figures.
[[nodiscard]] std::string sentence_of(WhyNot why, const Job& job, const Machine& machine, std::int64_t now_unix_ms);

/// JSON objects on one line, keys in fixed order.
[[nodiscard]] std::string to_json(const Job& job);
[[nodiscard]] std::string to_json(const Machine& machine);

}  // namespace telefab::fleet
