// SPDX-License-Identifier: GPL-3.0-or-later
#include <telefab/base/json_text.hpp>

#include <nlohmann/json.hpp>

namespace telefab {

using Json = nlohmann::ordered_json;

std::string json_text(const Json& value, int indent) {
  return value.dump(indent, ' ', false, Json::error_handler_t::replace);
}

Json parsed_json(std::string_view text) { return Json::parse(text); }

Json json_or_discarded(std::string_view text) { return Json::parse(text, nullptr, /*allow_exceptions=*/false); }

}  // namespace telefab
