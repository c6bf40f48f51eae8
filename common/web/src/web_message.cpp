// SPDX-License-Identifier: GPL-3.0-or-later
#include <algorithm>
#include <charconv>
#include <nlohmann/json.hpp>
#include <telefab/base/json_text.hpp>
#include <telefab/web/web_message.hpp>

#include "lower_case.hpp"

namespace telefab {

WebResponse web_problem(unsigned status, std::string_view code, std::string_view what) {
  const nlohmann::ordered_json value{{"error", {{"code", code}, {"what", what}}}};
  return {status, "application/json", json_text(value)};
}

WebResponse web_problem(const Error& error) {
  unsigned status = 500;
  switch (error.code) {
    case ErrorCode::NotFound:
      status = 404;
      break;
    case ErrorCode::InvalidInput:
      status = 400;
      break;
    case ErrorCode::Conflict:
      status = 409;
      break;
    case ErrorCode::NotPermitted:
    case ErrorCode::NotTrusted:
      status = 403;
      break;
    case ErrorCode::TooLarge:
      status = 413;
      break;
    case ErrorCode::Unreachable:
      status = 503;
      break;
    default:
      break;
  }
  return web_problem(status, name_of(error.code), error.what);
}

WebResponse web_sick(const Error& error) { return web_problem(503, name_of(error.code), error.what); }

WebResponse web_json(const Result<std::string>& body) {
  if (!body) return web_problem(body.error());
  return {200, "application/json", *body};
}

std::string host_name_of(std::string_view host) {
  std::string name = lower(host);
  const auto colon = name.rfind(':');
  if (colon != std::string::npos && name.find(']', colon) == std::string::npos) name.resize(colon);
  return name;
}

std::optional<std::uint64_t> query_number(std::string_view target, std::string_view key) {
  const auto begin = target.find('?');
  if (begin == std::string_view::npos) return std::nullopt;
  std::string_view rest = target.substr(begin + 1);
  while (!rest.empty()) {
    const std::string_view pair = rest.substr(0, rest.find('&'));
    rest.remove_prefix(std::min(pair.size() + 1, rest.size()));
    if (pair.size() <= key.size() || !pair.starts_with(key) || pair[key.size()] != '=') continue;
    const std::string_view digits = pair.substr(key.size() + 1);
    std::uint64_t number = 0;
    const auto [end, error] = std::from_chars(digits.data(), digits.data() + digits.size(), number);
    if (digits.empty() || error != std::errc{} || end != digits.data() + digits.size()) return std::nullopt;
    return number;
  }
  return std::nullopt;
}

WebResponse web_asset(std::span<const WebAsset> assets, std::string_view target) {
  const std::string_view path = target.substr(0, target.find('?'));
  for (const WebAsset& asset : assets)
    if (asset.path == path) {
      WebResponse found{200, std::string{asset.content_type}, std::string{asset.body}, path != "/"};
      found.is_immutable = path != "/" && target.size() > path.size() &&
                           target.substr(path.size()) == "?v=" + std::string{asset.version};
      return found;
    }
  return web_problem(404, "not-found", "no such page; the API begins at /v1/jobs");
}

}  // namespace telefab
