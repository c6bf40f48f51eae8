// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <memory>
#include <telefab/base/clock.hpp>
#include <telefab/net/trust.hpp>
#include <telefab/web/web_message.hpp>
#include <tl/expected.hpp>
#include <vector>

namespace telefab {

/// What a daemon shows over HTTP. Calls come from the server's thread one at a time; each returns soon and none throws.
class WebSite {
 public:
  virtual ~WebSite() = default;
  WebSite(const WebSite&) = delete;
  WebSite& operator=(const WebSite&) = delete;

  /// Who sends a request whose head alone has come, or the answer that refuses it. Asked again while a stream is open.
  [[nodiscard]] virtual tl::expected<Visitor, WebResponse> admit(const WebRequest& head) = 0;
  [[nodiscard]] virtual WebResponse answer(const WebRequest& request) = 0;
  /// How many bytes of body to take for a request whose head alone has come; 0: the small limit.
  [[nodiscard]] virtual std::uint64_t most_body(const WebRequest& head) = 0;
  /// The body of one event of /v1/stream, on one line.
  [[nodiscard]] virtual std::string event_data() = 0;
  /// Grows when event_data() would say something new.
  [[nodiscard]] virtual std::uint64_t revision() = 0;

 protected:
  WebSite() = default;
};

/// Where a page is served, under which names, and how much of it.
struct WebAddress {
  std::string host;
  std::uint16_t port = 0;                  ///< 0 takes a free one
  std::vector<std::string> names = {};     ///< further ones than loopback's and `host`
  std::shared_ptr<net::Trust> trust = {};  ///< serves over TLS; the server's thread alone uses it. Empty: HTTP
  std::size_t max_connections = 256;
  std::size_t max_streams = 192;  ///< of them; leaves room for the page and for an operator's click
  Nanoseconds look_every = std::chrono::milliseconds{250};  ///< for news to watchers
  Nanoseconds judge_every = std::chrono::seconds{5};        ///< whether who watches a stream still may
};

/// Serves a site over HTTP/1.1 (Boost.Beast) from one thread of its own, named "web". The site must outlive the server.
/// GET /v1/stream is a stream of server-sent events: one text for all watchers, made once a change, looked for four
/// times a second while anybody watches; a slow watcher misses events and never the newest. Limits: 16 KiB of headers,
/// 64 KiB of body unless the site takes more, 10 s for a TLS handshake, 30 s for a request. A newcomer who finds no
/// place takes that of the oldest connection which has not said who it is, of the address that holds the most.
/// Over TLS a client certificate is asked for and not needed; one that is shown is judged again for every request.
class WebServer {
 public:
  /// Listens at once. `product`: "telefab-fab/VERSION". Requests are answered only where their Host is one of the
  /// address's names, on whatever port: a page of somebody else's whose name was made to mean this address (DNS
  /// rebinding) is told nothing. Fails with Conflict where the port is taken, InvalidInput for a bad address.
  [[nodiscard]] static Result<std::unique_ptr<WebServer>> listen(const WebAddress& address, WebSite& site,
                                                                 const std::string& product, const Clock& clock);
  ~WebServer();  ///< closes every connection and joins the thread
  WebServer(const WebServer&) = delete;
  WebServer& operator=(const WebServer&) = delete;
  [[nodiscard]] std::uint16_t port() const;

 private:
  struct Impl;
  explicit WebServer(std::unique_ptr<Impl> impl);
  std::unique_ptr<Impl> impl_;
};

}  // namespace telefab
