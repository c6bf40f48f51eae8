// SPDX-License-Identifier: GPL-3.0-or-later
#include <array>
#include <random>
#include <span>
#include <telefab/test/http_client.hpp>

#include "web_fab.hpp"

namespace telefab::test {
namespace {

constexpr std::array kGetRoutes{"/",
                                "/page.js",
                                "/v1/version",
                                "/v1/health",
                                "/v1/devices",
                                "/v1/jobs",
                                "/v1/jobs/JOB",
                                "/v1/jobs/JOB/events",
                                "/v1/jobs/JOB/report",
                                "/v1/jobs/JOB/preflight",
                                "/v1/jobs/JOB/exposures",
                                "/v1/jobs/JOB/preview.png",
                                "/v1/jobs/JOB/accuracy.png",
                                "/v1/jobs/JOB/layers/3",
                                "/v1/jobs/JOB/layers/3/mask.png",
                                "/v1/jobs/JOB/approve",
                                "/v1/jobs/JOB/pause",
                                "/v1/jobs/JOB/resume",
                                "/v1/jobs/JOB/cancel",
                                "/metrics",
                                "/api/version",
                                "/api/job",
                                "/api/printer",
                                "/api/files/local",
                                "/api/v1/info",
                                "/api/v1/status",
                                "/api/v1/job",
                                "/api/v1/job/1",
                                "/api/v1/job/1/pause",
                                "/api/v1/storage",
                                "/api/v1/transfer",
                                "/api/v1/files/local",
                                "/api/v1/files/local/JOB",
                                "/prusalink/api/v1/status",
                                "/prusa-sla/api/version"};
constexpr std::array kPostRoutes{"/v1/jobs/JOB/approve",
                                 "/v1/jobs/JOB/pause",
                                 "/v1/jobs/JOB/resume",
                                 "/v1/jobs/JOB/cancel",
                                 "/api/job",
                                 "/api/files/local",
                                 "/v1/files/part.tfc",
                                 "/api/v1/files/local/JOB",
                                 "/prusalink/api/v1/files/usb/JOB"};
constexpr std::array kTricks{"/../../etc/passwd",
                             "/v1/jobs/../../../etc/passwd",
                             "/v1/jobs/%2e%2e%2f%2e%2e/events",
                             "/v1/jobs/..%5c..%5cx/report",
                             "/v1/jobs/JOB/layers/../../web-token",
                             "/v1/jobs/JOB/layers/-1/mask.png",
                             "/v1/jobs/JOB/layers/99999999999999999999",
                             "/v1/jobs/JOB%00/cancel",
                             "//v1//jobs",
                             "/v1/jobs/JOB/layers/4294967295/mask.png",
                             "http://elsewhere.example/v1/jobs",
                             "*",
                             "/web-token",
                             "/jobs.sqlite",
                             "/.%2e/.%2e/web-token",
                             "/api/v1/files/local/../../../etc/passwd",
                             "/api/v1/files/local/%2e%2e%2f%2e%2e%2fetc%2fcron.d%2fx.tfc",
                             "/api/v1/files/..%2f../part.tfc",
                             "/api/v1/files/local/%",
                             "/api/v1/files/local/a%00.tfc",
                             "/api/v1/job/99999999999999999999/pause",
                             "/prusalink/prusalink/api/version",
                             "/prusa-sla/../web-token"};
constexpr std::array kScanGetRoutes{"/",
                                    "/place.js",
                                    "/cloud.js",
                                    "/three.js",
                                    "/v1/link",
                                    "/v1/parameters",
                                    "/v1/profiles",
                                    "/v1/jobs",
                                    "/v1/jobs/JOB/layers/0",
                                    "/v1/uploads",
                                    "/v1/uploads/JOB",
                                    "/v1/uploads/JOB/levels/0?revision=1",
                                    "/v1/uploads/JOB/levels/4294967295?revision=18446744073709551615",
                                    "/v1/uploads/JOB/part?from=0",
                                    "/v1/uploads/JOB/submit",
                                    "/v1/uploads/JOB/discard",
                                    "/metrics"};
constexpr std::array kScanPostRoutes{
    "/v1/uploads",          "/v1/uploads/JOB/part?from=500", "/v1/uploads/JOB/part?from=18446744073709551615",
    "/v1/uploads/JOB/look", "/v1/uploads/JOB/estimate",      "/v1/uploads/JOB/orient",
    "/v1/uploads/JOB/join", "/v1/uploads/JOB/submit",        "/v1/uploads/JOB/discard",
    "/v1/jobs/JOB/cancel"};
constexpr std::array kScanTricks{"/v1/uploads/../../etc/passwd",
                                 "/v1/uploads/%2e%2e%2f%2e%2e/levels/0?revision=1",
                                 "/v1/uploads/JOB/levels/-1?revision=1",
                                 "/v1/uploads/JOB/levels/0?revision=-1",
                                 "/v1/uploads/JOB/levels/0?revision=1&revision=2",
                                 "/v1/uploads/JOB%00/discard",
                                 "/v1/uploads/JOB/part?from=%30",
                                 "/uploads/JOB/scan",
                                 "/web-token",
                                 "/three.js/../web-token"};
constexpr std::array kMethods{"PUT", "DELETE", "PATCH", "OPTIONS", "TRACE", "CONNECT", "get", "POST ", "X"};

std::string with_job(std::string path, const std::string& job) {
  if (const auto at = path.find("JOB"); at != std::string::npos) path.replace(at, 3, job);
  return path;
}

class Attacker {
 public:
  Attacker(std::uint16_t port, std::string job, std::uint64_t seed, HostileSite site)
      : port_{port}, job_{std::move(job)}, rng_{seed} {
    if (site == HostileSite::Fab) return;
    gets_ = kScanGetRoutes;
    posts_ = kScanPostRoutes;
    tricks_ = kScanTricks;
  }

  /// The answer's first line; empty where the server hung up unheard.
  std::string attack(std::size_t kind) {
    switch (kind) {
      case 0:  // noise
        return raw(noise(rng_() % 400) + "\r\n\r\n");
      case 1:  // a request with some bytes changed
        return raw(damaged("POST " + post_route() +
                           " HTTP/1.1\r\nHost: localhost\r\nX-Api-Key: 00\r\nContent-Length: 2\r\n\r\n{}"));
      case 2:  // path tricks, with and without a wrong key
        return raw(method_or("GET") + " " + with_job(pick(tricks_), job_) + " HTTP/1.1\r\nHost: localhost\r\n" +
                   wrong_key() + "\r\n");
      case 3:  // a body that is stated too large, and one that grows too large in chunks
        if (rng_() % 2)
          return raw("POST " + post_route() + " HTTP/1.1\r\nHost: localhost\r\n" + wrong_key() +
                     "Content-Length: 99999999999\r\n\r\n" + noise(2000));
        return raw("POST " + post_route() +
                   " HTTP/1.1\r\nHost: localhost\r\nTransfer-Encoding: chunked\r\n\r\n20000\r\n" +
                   std::string(0x20000, 'x') + "\r\n20000\r\n");
      case 4:  // headers without end
        return raw("GET / HTTP/1.1\r\nHost: localhost\r\nX: " + std::string(5000 + rng_() % 60'000, 'y') + "\r\n\r\n");
      case 5:  // what changes state, without the key or with a wrong one
        return raw("POST " + post_route() + " HTTP/1.1\r\nHost: localhost\r\n" + wrong_key() +
                   "Content-Length: 20\r\n\r\n{\"command\":\"cancel\"}");
      case 6:  // lies about lengths
        return raw("POST " + post_route() +
                   " HTTP/1.1\r\nHost: localhost\r\nContent-Length: 5\r\nContent-Length: 50\r\nTransfer-Encoding: "
                   "chunked\r\n\r\n-1\r\n");
      case 7:  // hangs up in the middle
        return hang_up("POST " + post_route() + " HTTP/1.1\r\nHost: localhost\r\nContent-Length: 4000\r\n\r\nabc");
      case 8:  // methods that no route takes
        return raw(std::string{pick(kMethods)} + " " + with_job(pick(gets_), job_) +
                   " HTTP/1.1\r\nHost: localhost\r\n\r\n");
      default:  // every route with GET and HEAD
        return raw(std::string{rng_() % 4 ? "GET" : "HEAD"} + " " +
                   with_job(gets_[next_route_++ % gets_.size()], job_) + " HTTP/1.1\r\nHost: localhost\r\n" +
                   "Connection: close\r\n\r\n");
    }
  }
  std::uint64_t next() { return rng_(); }

 private:
  template <class List>
  const char* pick(const List& list) {
    return list[rng_() % list.size()];
  }
  std::string post_route() { return with_job(pick(posts_), job_); }
  std::string method_or(const char* usual) { return rng_() % 3 ? usual : "POST"; }
  std::string wrong_key() {
    switch (rng_() % 7) {
      case 4:
        return "Authorization: Digest " + noise_text(rng_() % 400) + "\r\n";
      case 5:
        return "Authorization: Digest username=\"web\", realm=\"Telefab\", nonce=\"" + std::string(rng_() % 200, '0') +
               "\", uri=\"/api/v1/files/local/JOB\", qop=auth, nc=ffffffff, cnonce=\"x\", response=\"" +
               std::string(rng_() % 2 ? 64 : 32, 'a') + "\"\r\n";
      case 6:
        return "Authorization: Digest username=\"" + std::string(rng_() % 3000, 'u') + "\"\r\nOverwrite: ?1\r\n" +
               "Print-After-Upload: ?1\r\n";
      case 0:
        return "";
      case 1:
        return "X-Api-Key: \r\n";
      case 2:
        return "Authorization: Bearer 0123456789abcdef0123456789abcdef\r\n";
      default:
        return "X-Api-Key: " + std::string(rng_() % 300, 'f') + "\r\n";
    }
  }
  std::string noise(std::size_t size) {
    std::string text(size, '\0');
    for (char& c : text) c = static_cast<char>(rng_());
    return text;
  }
  /// Of characters that may stand in a header.
  std::string noise_text(std::size_t size) {
    std::string text(size, ' ');
    for (char& c : text) c = static_cast<char>(' ' + rng_() % 95);
    return text;
  }
  std::string damaged(std::string text) {
    for (auto n = 1 + rng_() % 6; n > 0; --n) text[rng_() % text.size()] = static_cast<char>(rng_());
    return text + "\r\n\r\n";
  }
  std::string raw(const std::string& bytes) {
    const HttpClient client{port_, 2};
    client.send(bytes);
    ::shutdown(client.descriptor(), SHUT_WR);
    const std::string answer = client.read_until("\r\n");
    return answer.substr(0, answer.find("\r\n"));
  }
  std::string hang_up(const std::string& bytes) {
    const HttpClient client{port_};
    client.send(bytes);
    return {};
  }

  std::span<const char* const> gets_ = kGetRoutes;
  std::span<const char* const> posts_ = kPostRoutes;
  std::span<const char* const> tricks_ = kTricks;
  std::uint16_t port_;
  std::string job_;
  std::mt19937_64 rng_;
  std::size_t next_route_ = 0;
};

}  // namespace

HostileCount ask_hostile(std::uint16_t port, const std::string& job, std::size_t count, std::uint64_t seed,
                         HostileSite site) {
  constexpr std::size_t kKinds = 10;
  Attacker attacker{port, job, seed, site};
  HostileCount found;
  for (; found.asked < count; ++found.asked) {
    const std::size_t kind = found.asked % kKinds;
    const std::string line = attacker.attack(kind);
    // Damage may hit what does not matter, headers may just fit, and a GET is always fine.
    const bool may_succeed = kind <= 2 || kind == 4 || kind >= 8;
    const bool is_success = line.starts_with("HTTP/1.1 2");
    if ((is_success && !may_succeed) || line.starts_with("HTTP/1.1 5")) {
      if (found.wrong++ == 0) found.first_wrong = std::to_string(kind) + ": " + line;
    }
  }
  return found;
}

}  // namespace telefab::test
