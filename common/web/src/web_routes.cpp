// SPDX-License-Identifier: GPL-3.0-or-later
#include <charconv>
#include <optional>
#include <telefab/web/web_routes.hpp>

namespace telefab {
namespace {

/// A segment of a path that may stand for {id}: what job ids are made of, nothing a file system could misread.
bool is_id(std::string_view text) {
  if (text.empty() || text.size() > 128) return false;
  for (const char c : text)
    if (!((c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || (c >= '0' && c <= '9') || c == '-' || c == '_'))
      return false;
  return true;
}

std::optional<PathArguments> match(std::string_view pattern, std::string_view path) {
  PathArguments arguments;
  while (true) {
    if (pattern == "{path}") {
      auto rest = without_escapes(path);
      if (!rest || rest->empty()) return std::nullopt;
      arguments.path = std::move(*rest);
      return arguments;
    }
    const auto next = [](std::string_view& rest) {
      const auto slash = rest.find('/');
      const std::string_view segment = rest.substr(0, slash);
      rest = slash == std::string_view::npos ? std::string_view{} : rest.substr(slash + 1);
      return std::pair{segment, slash != std::string_view::npos};
    };
    const auto [wanted, wanted_more] = next(pattern);
    const auto [found, found_more] = next(path);
    if (wanted_more != found_more) return std::nullopt;
    if (wanted == "{id}" || wanted == "{storage}") {
      if (!is_id(found)) return std::nullopt;
      (wanted == "{id}" ? arguments.id : arguments.storage) = found;
    } else if (wanted == "{layer}") {
      const auto [end, error] = std::from_chars(found.data(), found.data() + found.size(), arguments.layer);
      if (found.empty() || error != std::errc{} || end != found.data() + found.size()) return std::nullopt;
    } else if (wanted != found) {
      return std::nullopt;
    }
    if (!wanted_more) return arguments;
  }
}

}  // namespace

tl::expected<Routed, WebResponse> find_row(std::span<const WebRoute> routes, const WebRequest& request) {
  const std::string_view path = std::string_view{request.target}.substr(0, request.target.find('?'));
  const std::string_view method = request.method == "HEAD" ? std::string_view{"GET"} : std::string_view{request.method};
  bool path_known = false;
  for (std::size_t row = 0; row < routes.size(); ++row) {
    auto arguments = match(routes[row].path, path);
    if (!arguments) continue;
    path_known = true;
    if (routes[row].method != method) continue;
    return Routed{row, std::move(*arguments), {}};
  }
  if (path_known)
    return tl::unexpected{web_problem(405, "not-permitted", "this address does not take the method " + request.method)};
  return tl::unexpected{web_problem(404, "not-found", "no such address; the API begins at /v1/jobs")};
}

tl::expected<Routed, WebResponse> find_route(std::span<const WebRoute> routes, const WebRequest& request,
                                             SignIn& sign_in) {
  auto routed = find_row(routes, request);
  if (!routed) return routed;
  auto visitor = sign_in.admit(request, routes[routed->row].needs);
  if (!visitor) return tl::unexpected{web_problem(visitor.error().status, "not-permitted", visitor.error().what)};
  routed->visitor = std::move(*visitor);
  return routed;
}

}  // namespace telefab
