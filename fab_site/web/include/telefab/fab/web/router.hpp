// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <string>
#include <telefab/fab/web/page_backend.hpp>
#include <telefab/web/web_routes.hpp>
#include <telefab/web/web_server.hpp>
#include <vector>

namespace telefab::fab {

struct WebOptions {
  std::string version = {};   ///< of the program
  std::string three_js = {};  ///< the text of three.min.js (Debian libjs-three) for the 3-D view; empty: no 3-D view
};

/// The API, row by row.
[[nodiscard]] const std::vector<WebRoute>& web_routes();

/// What the site answers at /openapi.json.
[[nodiscard]] std::string open_api_json();

/// Answers one request. Never throws, touches no socket. GET and HEAD never change state; whatever changes state is a
/// POST, PUT or DELETE of an operator whom `sign_in` knows. Unknown paths are 404, known paths with another method 405.
[[nodiscard]] WebResponse answer(const WebRequest& request, PageBackend& backend, SignIn& sign_in,
                                 const WebOptions& options);

/// The body of one event of the stream: jobs and machines as JSON on one line.
[[nodiscard]] std::string event_data(PageBackend& backend);

/// The page and the API of a backend, which must outlive it, as `sign_in` must.
class FabWeb final : public WebSite {
 public:
  FabWeb(PageBackend& backend, SignIn& sign_in, WebOptions options)
      : backend_{backend}, sign_in_{sign_in}, options_{std::move(options)} {}
  tl::expected<Visitor, WebResponse> admit(const WebRequest& head) override;
  WebResponse answer(const WebRequest& request) override { return fab::answer(request, backend_, sign_in_, options_); }
  std::uint64_t most_body(const WebRequest& head) override;
  std::string event_data() override { return fab::event_data(backend_); }
  std::uint64_t revision() override { return backend_.revision(); }

 private:
  PageBackend& backend_;
  SignIn& sign_in_;
  WebOptions options_;
};

}  // namespace telefab::fab
