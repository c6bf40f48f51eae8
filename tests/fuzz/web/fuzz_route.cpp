// SPDX-License-Identifier: GPL-3.0-or-later
#include <array>
#include <cstdint>
#include <cstdlib>
#include <string>
#include <telefab/web/web_routes.hpp>

// "METHOD TARGET\nAUTHORIZATION": nothing that needs the token is found without it, and no id can name another folder.
extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace telefab;
  static constexpr std::array kRoutes{
      WebRoute{"GET", "/", "page", Access::Anybody},
      WebRoute{"GET", "/v1/jobs", "list"},
      WebRoute{"GET", "/v1/jobs/{id}", "one"},
      WebRoute{"GET", "/v1/jobs/{id}/layers/{layer}/mask.png", "mask", Access::Operators},
      WebRoute{"POST", "/v1/jobs/{id}/approve", "approve", Access::Operators},
      WebRoute{"PUT", "/api/v1/files/{storage}/{path}", "upload", Access::Operators},
  };
  const std::string_view all{reinterpret_cast<const char*>(data), size};
  const std::size_t line = std::min(all.find('\n'), all.size());
  const std::string_view head = all.substr(0, line);
  const std::size_t space = std::min(head.find(' '), head.size());
  WebRequest request;
  request.method = head.substr(0, space);
  request.target = head.substr(std::min(space + 1, head.size()));
  request.authorization = all.substr(std::min(line + 1, all.size()));
  static const VirtualClock kClock;
  SignIn sign_in{{.shared_token = "secret"}, kClock};
  const auto routed = find_route(kRoutes, request, sign_in);
  if (!routed) {
    if (routed.error().status < 400 || routed.error().body.empty()) std::abort();
    return 0;
  }
  const WebRoute& route = kRoutes.at(routed->row);
  if (route.needs == Access::Operators && request.authorization != "Bearer secret") std::abort();
  if (routed->arguments.id.find_first_of("./\\%") != std::string::npos) std::abort();
  if (routed->arguments.storage.find_first_of("./\\%") != std::string::npos) std::abort();
  if (routed->arguments.path.size() > request.target.size()) std::abort();
  return 0;
}
