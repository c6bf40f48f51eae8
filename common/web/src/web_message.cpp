// SPDX-License-Identifier: GPL-3.0-or-later
#include <algorithm>
#include <charconv>
#include <nlohmann/json.hpp>
#include <telefab/base/json_text.hpp>
#include <telefab/web/web_message.hpp>

#include "lower_case.hpp"

namespace telefab {
namespace {

int hex_digit(char c) {
  return c >= '0' && c <= '9'   ? c - '0'
         : c >= 'a' && c <= 'f' ? c - 'a' + 10
         : c >= 'A' && c <= 'F' ? c - 'A' + 10
                                : -1;
}

/// As it stands behind KEY= in the query.
std::optional<std::string_view> query_value(std::string_view target, std::string_view key) {
  const auto begin = target.find('?');
  if (begin == std::string_view::npos) return std::nullopt;
  std::string_view rest = target.substr(begin + 1);
  while (!rest.empty()) {
    const std::string_view pair = rest.substr(0, rest.find('&'));
    rest.remove_prefix(std::min(pair.size() + 1, rest.size()));
    if (pair.size() > key.size() && pair.starts_with(key) && pair[key.size()] == '=')
      return pair.substr(key.size() + 1);
  }
  return std::nullopt;
}

}  // namespace

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

std::optional<std::string> without_escapes(std::string_view text) {
  std::string out;
  for (std::size_t i = 0; i < text.size(); ++i) {
    if (text[i] != '%') {
      out += text[i];
      continue;
    }
    const int high = i + 2 < text.size() ? hex_digit(text[i + 1]) : -1;
    const int low = high < 0 ? -1 : hex_digit(text[i + 2]);
    if (low < 0) return std::nullopt;
    out += static_cast<char>(high * 16 + low);
    i += 2;
  }
  return out;
}

std::optional<std::string> query_text(std::string_view target, std::string_view key) {
  const auto value = query_value(target, key);
  if (!value) return std::nullopt;
  std::string with_blanks{*value};
  std::replace(with_blanks.begin(), with_blanks.end(), '+', ' ');
  return without_escapes(with_blanks).value_or(with_blanks);
}

std::optional<std::uint64_t> query_number(std::string_view target, std::string_view key) {
  const auto digits = query_value(target, key);
  if (!digits) return std::nullopt;
  std::uint64_t number = 0;
  const auto [end, error] = std::from_chars(digits->data(), digits->data() + digits->size(), number);
  if (digits->empty() || error != std::errc{} || end != digits->data() + digits->size()) return std::nullopt;
  return number;
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
