#pragma once
#include <string>
#include <string_view>
#include <telefab/fab/web/job_desk.hpp>
#include <vector>

namespace telefab::fab {

/// A request as far as the routes care. `target` is as sent, percent-encoded, with its query.
struct WebRequest {
  std::string method;
  std::string target;
  std::string authorization;  ///< the Authorization header, or "Bearer KEY" made of X-Api-Key
};

struct WebResponse {
  unsigned status = 200;
  std::string content_type = "application/json";
  std::string body;
  bool cacheable = false;  ///< true for what never changes under its address
};

struct WebOptions {
  std::string token;     ///< what a caller must show to change anything; empty: nothing can be changed over the web
  std::string version;   ///< of the program
  std::string three_js;  ///< the text of three.min.js (Debian libjs-three) for the 3-D view; empty: no 3-D view
};

/// One row of the API: `telefab-fab` prints them, the OpenAPI file is checked against them, tests walk over them.
struct WebRoute {
  std::string_view method;
  std::string_view path;  ///< {id} and {layer} stand for one segment
  std::string_view summary;
  bool changes_state;
};
[[nodiscard]] const std::vector<WebRoute>& web_routes();

/// Answers one request. Never throws, touches no socket. GET and HEAD never change state; whatever changes state is a
/// POST with the token. Unknown paths are 404, known paths with another method 405.
[[nodiscard]] WebResponse answer(const WebRequest& request, JobDesk& desk, const WebOptions& options);

/// The body of one event of the stream: the job list as JSON on one line.
[[nodiscard]] std::string event_data(JobDesk& desk);

}  // namespace telefab::fab
