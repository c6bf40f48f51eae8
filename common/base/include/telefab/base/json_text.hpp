// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <nlohmann/json_fwd.hpp>
#include <string>
#include <string_view>

namespace telefab {

/// `value` as JSON, keys in their order: in one line, or with `indent` blanks a level. Bytes inside that are not UTF-8,
/// such as a file's name from elsewhere, become U+FFFD: no report is lost for a name.
[[nodiscard]] std::string json_text(const nlohmann::ordered_json& value, int indent = -1);

/// What `text` says in JSON. Throws nlohmann::ordered_json::parse_error where it is none: for readers that catch with
/// it what is missing or of another kind.
[[nodiscard]] nlohmann::ordered_json parsed_json(std::string_view text);

/// The same, but a discarded value (is_discarded()) instead of throwing.
[[nodiscard]] nlohmann::ordered_json json_or_discarded(std::string_view text);

}  // namespace telefab
