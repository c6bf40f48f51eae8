#pragma once
#include <cstdint>
#include <memory>
#include <string>
#include <telefab/fab/web/router.hpp>

namespace telefab::fab {

/// Serves the page and the API over HTTP/1.1 (Boost.Beast) from one thread of its own, named "web".
/// The desk must outlive the server. Limits: 64 KiB of headers and body, 30 s for a request, 64 connections,
/// of which 56 may be event streams.
class WebServer {
 public:
  /// Listens at once; port 0 takes a free one. Fails with Conflict where the port is taken, InvalidInput for a bad
  /// address.
  [[nodiscard]] static Result<std::unique_ptr<WebServer>> listen(const std::string& host, std::uint16_t port,
                                                                 JobDesk& desk, WebOptions options);
  ~WebServer();  ///< closes every connection and joins the thread
  WebServer(const WebServer&) = delete;
  WebServer& operator=(const WebServer&) = delete;
  [[nodiscard]] std::uint16_t port() const;

 private:
  struct Impl;
  explicit WebServer(std::unique_ptr<Impl> impl);
  std::unique_ptr<Impl> impl_;
};

}  // namespace telefab::fab
