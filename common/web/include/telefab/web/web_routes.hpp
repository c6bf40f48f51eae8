// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <span>
#include <telefab/web/web_message.hpp>
#include <tl/expected.hpp>

namespace telefab {

/// One row of an API: the OpenAPI file is checked against the rows, tests walk over them.
struct WebRoute {
  std::string_view method;
  std::string_view path;  ///< {id} and {layer} stand for one segment
  std::string_view summary;
  bool changes_state = false;   ///< a POST that needs the operator's token
  bool needs_token = false;     ///< does not change anything and still is for the operator only
  std::uint64_t most_body = 0;  ///< bytes; 0: WebServer's small limit
};

/// What stood for {id} and {layer} in a path.
struct PathArguments {
  std::string id;
  std::uint32_t layer = 0;
};

/// The row a request means.
struct Routed {
  std::size_t row = 0;
  PathArguments arguments;
};

/// The row for a request, or the answer that refuses it: 404 for an unknown path, 405 for a known one with another
/// method, 401 without the token where one is needed. HEAD counts as GET. An empty `token` lets nobody change anything.
[[nodiscard]] tl::expected<Routed, WebResponse> find_route(std::span<const WebRoute> routes, const WebRequest& request,
                                                           std::string_view token);

}  // namespace telefab
