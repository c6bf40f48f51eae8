// SPDX-License-Identifier: GPL-3.0-or-later
#include <algorithm>
#include <array>
#include <cstdint>
#include <cstdlib>
#include <string>
#include <telefab/fab/web/router.hpp>
#include <telefab/test/recording_backend.hpp>
#include <vector>

#include "../scratch_file.hpp"

namespace {

using namespace telefab;

/// Two people with tokens of their own, once a process: an operator and a reader.
struct People {
  People() {
    std::filesystem::remove(file.path());
    ada = add_operator_token(file.path(), "ada", Access::Operators, std::chrono::seconds{1}).value();
    eve = add_operator_token(file.path(), "eve", Access::Readers, std::chrono::seconds{1}).value();
  }
  test::ScratchFile file{nullptr, 0, "people"};
  std::string ada, eve;
};

const People& people() {
  static const People all;
  return all;
}

struct Session {
  std::string cookie;  ///< name and value
  Access may;
  bool is_over = false;
};

std::string replaced(std::string text, std::string_view mark, std::string_view value) {
  for (auto at = text.find(mark); at != std::string::npos; at = text.find(mark, at + value.size()))
    text.replace(at, mark.size(), value);
  return text;
}

std::string lowered(std::string text) {
  std::ranges::transform(text, text.begin(), [](unsigned char c) { return static_cast<char>(std::tolower(c)); });
  return text;
}

std::size_t changes(const fab::RecordingBackend& backend) {
  return backend.actions.size() + backend.approvals.size() + backend.cleared.size() + backend.files.size();
}

bool may_change(std::string_view method) { return method == "POST" || method == "PUT" || method == "DELETE"; }

bool shows_a_part(const WebResponse& response) {
  static constexpr std::array kOfAPart{"statue", "layers\":3", "islands", "irradiance", "certificate\":", "queued"};
  return response.status == 200 && response.content_type != "text/javascript; charset=utf-8" &&
         (response.content_type == "image/png" || std::ranges::any_of(kOfAPart, [&](const char* text) {
            return response.content_type == "application/json" && response.body.find(text) != std::string::npos;
          }));
}

/// What a request could at most be allowed, by what it shows and by nothing else.
Access most_allowed(const WebRequest& request, const std::vector<Session>& sessions) {
  const bool is_change = request.method != "GET" && request.method != "HEAD";
  const std::string here = "://" + lowered(request.host);
  const std::string origin = lowered(request.origin);
  const bool is_from_here = origin == "https" + here || (!request.is_encrypted && origin == "http" + here);
  Access most = Access::Anybody;
  if (request.authorization == "Bearer " + people().ada) most = Access::Operators;
  if (request.authorization == "Bearer " + people().eve) most = std::max(most, Access::Readers);
  for (const Session& session : sessions)
    if (!session.is_over && request.cookie.find(session.cookie) != std::string::npos && (!is_change || is_from_here))
      most = std::max(most, session.may);
  if (request.certified && (!is_change || request.origin.empty() || is_from_here))
    most = std::max(most, request.certified->may);
  return most;
}

}  // namespace

// Requests to the fab's page where everybody signs in, one behind the other. A request is "METHOD TARGET" and lines
// that begin with a letter: a(uthorization), c(ookie), o(rigin), h(ost), b(ody), t (over TLS), x and y (with a
// certificate of an operator, of a reader); w lets 13 hours pass; an empty line ends it. @a and @e stand for the
// tokens, @s for the newest session. Nothing of a part is shown, and nothing changed, but to whom it is allowed.
extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  VirtualClock clock;
  SignIn sign_in{{.tokens = people().file.path(), .shared_token = "the-shared-token"}, clock};
  fab::RecordingBackend backend;
  fab::FabWeb site{backend, sign_in, {.version = "0", .three_js = ""}};
  std::vector<Session> sessions;
  WebRequest request;
  bool has_request = false;
  const auto ask = [&] {
    if (!std::exchange(has_request, false)) return;
    const std::string name = host_name_of(request.host);
    const std::string host = lowered(request.host);
    if (!host.starts_with(name) || (name.size() < host.size() && host[name.size()] != ':')) std::abort();
    const Access allowed = most_allowed(request, sessions);
    const std::size_t before = changes(backend);
    const auto admitted = site.admit(request);
    const WebResponse response = site.answer(request);
    if (response.status < 200 || response.status > 421 || (response.status != 204 && response.body.empty()))
      std::abort();
    if (admitted && admitted->may > allowed) std::abort();
    if (changes(backend) != before && (allowed != Access::Operators || !may_change(request.method))) std::abort();
    if (shows_a_part(response) && allowed == Access::Anybody) std::abort();
    if (!response.cookie.empty()) {
      const std::string cookie = response.cookie.substr(0, response.cookie.find(';'));
      if (response.cookie.find("; HttpOnly; SameSite=Strict") == std::string::npos) std::abort();
      if (!cookie.ends_with('='))
        sessions.push_back(
            {cookie, request.body.find(people().ada) != std::string::npos ? Access::Operators : Access::Readers});
      else
        for (Session& session : sessions) session.is_over |= request.cookie == session.cookie;
    }
    request = {};
  };
  std::string_view rest{reinterpret_cast<const char*>(data), size};
  while (!rest.empty()) {
    const std::size_t end = std::min(rest.find('\n'), rest.size());
    std::string line{rest.substr(0, end)};
    rest.remove_prefix(std::min(end + 1, rest.size()));
    if (line.empty()) {
      ask();
      continue;
    }
    line = replaced(replaced(line, "@a", people().ada), "@e", people().eve);
    line = replaced(line, "@s", sessions.empty() ? "" : sessions.back().cookie);
    const std::string value = line.size() > 2 ? line.substr(2) : "";
    if (!has_request) {
      has_request = true;
      const std::size_t space = std::min(line.find(' '), line.size());
      request.method = line.substr(0, space);
      request.target = line.substr(std::min(space + 1, line.size()));
      continue;
    }
    switch (line[0]) {
      case 'a':
        request.authorization = value;
        break;
      case 'c':
        request.cookie = value;
        break;
      case 'o':
        request.origin = value;
        break;
      case 'h':
        request.host = value;
        break;
      case 'b':
        request.body = value;
        break;
      case 't':
        request.is_encrypted = true;
        break;
      case 'x':
        request.certified = Visitor{"otto", Access::Operators};
        break;
      case 'y':
        request.certified = Visitor{"rita", Access::Readers};
        break;
      case 'w':
        clock.sleep_for(std::chrono::hours{13});
        for (Session& session : sessions) session.is_over = true;
        break;
      default:
        break;
    }
  }
  ask();
  return 0;
}
