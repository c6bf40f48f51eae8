// SPDX-License-Identifier: GPL-3.0-or-later
#include "sender_api.hpp"

#include <algorithm>
#include <array>
#include <nlohmann/json.hpp>
#include <telefab/base/json_text.hpp>

#include "octoprint.hpp"
#include "prusalink.hpp"

namespace telefab::fab {
namespace {

constexpr std::string_view kPath = "/api/";
constexpr std::string_view kPathV1 = "/api/v1/";

struct Kind {
  SenderApi api;
  std::string_view prefix;
  std::string_view text;
  std::string_view version;  ///< of the API
};
constexpr std::array kKinds{
    Kind{SenderApi::OctoPrint, "", "OctoPrint", "0.1"},
    Kind{SenderApi::PrusaLink, "/prusalink", "PrusaLink", "2.0.0"},
    Kind{SenderApi::PrusaSla, "/prusa-sla", "Prusa SLA", "0.1"},
};

}  // namespace

SenderRequest read_sender(WebRequest request) {
  // A storage is also asked for as a folder.
  const auto drop_slash = [](WebRequest asked) {
    const std::string_view target = asked.target;
    if (target.starts_with("/api/v1/files/") && target.ends_with('/') && std::ranges::count(target, '/') == 5) {
      if (asked.sent_target.empty()) asked.sent_target = asked.target;
      asked.target.pop_back();
    }
    return asked;
  };
  for (const Kind& kind : kKinds) {
    const std::string_view target = request.target;
    if (kind.prefix.empty() || !target.starts_with(kind.prefix) || !is_of_sender(target.substr(kind.prefix.size())))
      continue;
    request.sent_target = request.target;
    request.target.erase(0, kind.prefix.size());
    return {kind.api, drop_slash(std::move(request))};
  }
  return {SenderApi::OctoPrint, drop_slash(std::move(request))};
}

bool is_of_sender(std::string_view target) { return target.starts_with(kPath); }

WebResponse version_for(SenderApi api, const std::string& version) {
  const Kind& kind = kKinds.at(static_cast<std::size_t>(api));
  const nlohmann::ordered_json value{{"api", kind.version},
                                     {"server", version},
                                     {"version", version},
                                     {"text", std::string{kind.text} + " (Telefab " + version + ")"},
                                     {"capabilities", {{"upload-by-put", true}}}};
  return {200, "application/json", json_text(value)};
}

WebResponse refuse_sender(const SenderRequest& asked, const SignIn::Refusal& refusal, SignIn& sign_in) {
  const WebRequest& request = asked.request;
  const bool is_v1 = request.target.starts_with(kPathV1);
  const bool is_key = request.authorization.starts_with("Bearer ");
  // OctoPrint says 403 to a wrong key; who shows none may still log in.
  const bool is_octoprint = asked.api == SenderApi::OctoPrint && !is_v1;
  const unsigned status = is_octoprint && is_key ? 403 : refusal.status;
  WebResponse response =
      is_v1 ? prusalink_problem(status, refusal.what) : octoprint_problem(status, "X-Api-Key: " + refusal.what);
  // The browser of a page would ask for a password.
  if (status == 401 && request.origin.empty() && request.cookie.empty())
    response.challenges = sign_in.challenges(refusal);
  return response;
}

}  // namespace telefab::fab
