// SPDX-License-Identifier: GPL-3.0-or-later
#include <algorithm>
#include <cctype>
#include <telefab/web/form_data.hpp>

#include "lower_case.hpp"

namespace telefab {
namespace {

constexpr std::size_t kMaxFields = 32;
constexpr std::size_t kLongestBoundary = 70;  // RFC 2046, 5.1.1

/// The value of `key` in "...; key=value; other=\"quoted\"", quoted or not; empty where it is missing.
std::string parameter(std::string_view header, std::string_view key) {
  bool is_quoted = false;
  for (std::size_t at = 0; at < header.size(); ++at) {
    if (header[at] == '"') is_quoted = !is_quoted;
    if (is_quoted || header[at] != ';') continue;
    std::size_t begin = at + 1;
    while (begin < header.size() && header[begin] == ' ') ++begin;
    std::string_view rest = header.substr(begin);
    if (rest.size() <= key.size() || lower(rest.substr(0, key.size())) != key || rest[key.size()] != '=') continue;
    rest.remove_prefix(key.size() + 1);
    if (!rest.starts_with('"')) return std::string{rest.substr(0, rest.find_first_of("; \t"))};
    std::string value;
    for (std::size_t i = 1; i < rest.size() && rest[i] != '"'; ++i) {
      if (rest[i] == '\\' && i + 1 < rest.size()) ++i;
      value += rest[i];
    }
    return value;
  }
  return {};
}

Result<std::vector<FormField>> broken(const char* what) {
  return fail(ErrorCode::InvalidInput, std::string{"the form: "} + what);
}

/// The Content-Disposition among a part's headers; empty where there is none.
std::string_view disposition(std::string_view headers) {
  constexpr std::string_view name = "content-disposition:";
  while (!headers.empty()) {
    const auto end = std::min(headers.find("\r\n"), headers.size());
    const std::string_view line = headers.substr(0, end);
    if (lower(line.substr(0, name.size())) == name) return line.substr(name.size());
    headers.remove_prefix(std::min(end + 2, headers.size()));
  }
  return {};
}

}  // namespace

Result<std::vector<FormField>> form_fields(std::string_view content_type, std::string_view body) {
  if (!lower(content_type).starts_with("multipart/form-data")) return broken("multipart/form-data is wanted");
  const std::string boundary = parameter(content_type, "boundary");
  if (boundary.empty() || boundary.size() > kLongestBoundary) return broken("its content type names no boundary");
  const std::string mark = "\r\n--" + boundary;
  std::string_view rest = body;
  // The first mark has no line before it where there is no preamble.
  if (rest.starts_with(mark.substr(2))) {
    rest.remove_prefix(mark.size() - 2);
  } else {
    const auto first = rest.find(mark);
    if (first == std::string_view::npos) return broken("the boundary does not occur in it");
    rest.remove_prefix(first + mark.size());
  }
  std::vector<FormField> fields;
  while (!rest.starts_with("--")) {
    if (!rest.starts_with("\r\n")) return broken("a boundary is followed by something else than a new line");
    const auto headers_end = rest.find("\r\n\r\n");
    if (headers_end == std::string_view::npos) return broken("a field has no end of its headers");
    const std::string_view headers = headers_end == 0 ? std::string_view{} : rest.substr(2, headers_end - 2);
    rest.remove_prefix(headers_end + 4);
    const auto end = rest.find(mark);
    if (end == std::string_view::npos) return broken("it ends inside a field");
    const std::string_view about = disposition(headers);
    if (fields.size() == kMaxFields) return broken("too many fields");
    fields.push_back({parameter(about, "name"), parameter(about, "filename"), rest.substr(0, end)});
    rest.remove_prefix(end + mark.size());
  }
  return fields;
}

}  // namespace telefab
