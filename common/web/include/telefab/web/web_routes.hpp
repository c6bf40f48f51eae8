// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <array>
#include <span>
#include <telefab/web/sign_in.hpp>
#include <telefab/web/web_message.hpp>
#include <tl/expected.hpp>
#include <vector>

namespace telefab {

/// One row of an API: the OpenAPI file is checked against the rows, tests walk over them.
struct WebRoute {
  std::string_view method;
  std::string_view path;  ///< {id}, {layer} and {storage} stand for one segment, {path} for one or more up to the end
  std::string_view summary;
  Access needs = Access::Readers;
  std::uint64_t most_body = 0;  ///< bytes; 0: WebServer's small limit
};

/// What every page has for signing in: SignIn answers them, in this order by session, sign_in and sign_out.
inline constexpr std::array<WebRoute, 3> kSignInRoutes{{
    {"GET", "/v1/session", "who is signed in here, and whether somebody has to be", Access::Anybody},
    {"POST", "/v1/sign-in", "begin a session with a token or a link", Access::Anybody},
    {"POST", "/v1/sign-out", "end the session", Access::Anybody},
}};

/// The routes of a table whose rows carry one each, in its order.
template <class Rows>
[[nodiscard]] std::vector<WebRoute> routes_of(const Rows& rows) {
  std::vector<WebRoute> routes;
  for (const auto& row : rows) routes.push_back(row.route);
  return routes;
}

/// What stood for {id}, {layer}, {storage} and {path} in a path.
struct PathArguments {
  std::string id;
  std::string storage;
  std::string path;  ///< its percent signs read, so any bytes at all
  std::uint32_t layer = 0;
};

/// The row a request means.
struct Routed {
  std::size_t row = 0;
  PathArguments arguments;
  Visitor visitor;  ///< empty where the row needs nobody
};

/// The row for a request, whoever sends it (its visitor is empty), or the answer that refuses it: 404 for an unknown
/// path, 405 for a known one with another method. HEAD counts as GET.
[[nodiscard]] tl::expected<Routed, WebResponse> find_row(std::span<const WebRoute> routes, const WebRequest& request);

/// The row for a request, or the answer that refuses it: 404 for an unknown path, 405 for a known one with another
/// method, 401 and 403 as SignIn has it. HEAD counts as GET.
[[nodiscard]] tl::expected<Routed, WebResponse> find_route(std::span<const WebRoute> routes, const WebRequest& request,
                                                           SignIn& sign_in);

}  // namespace telefab
