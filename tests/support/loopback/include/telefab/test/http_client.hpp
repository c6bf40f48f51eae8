// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <arpa/inet.h>
#include <sys/socket.h>
#include <sys/time.h>
#include <unistd.h>

#include <cstdint>
#include <string>
#include <string_view>
#include <telefab/test/loopback.hpp>

namespace telefab::test {

/// One connection to an HTTP server on loopback, byte by byte; for tests only.
class HttpClient {
 public:
  /// `from`: an address of loopback to ask from; null: whichever the system takes.
  explicit HttpClient(std::uint16_t port, int patience_s = 10, const char* from = nullptr)
      : fd_{::socket(AF_INET, SOCK_STREAM, 0)} {
    const timeval limit{patience_s, 0};
    ::setsockopt(fd_, SOL_SOCKET, SO_RCVTIMEO, &limit, sizeof limit);
    if (from) {
      sockaddr_in own = loopback(0);
      ::inet_pton(AF_INET, from, &own.sin_addr);
      (void)::bind(fd_, reinterpret_cast<const sockaddr*>(&own), sizeof own);
    }
    const sockaddr_in address = loopback(port);
    connected_ = ::connect(fd_, reinterpret_cast<const sockaddr*>(&address), sizeof address) == 0;
  }
  ~HttpClient() { ::close(fd_); }
  HttpClient(const HttpClient&) = delete;
  HttpClient& operator=(const HttpClient&) = delete;
  [[nodiscard]] bool connected() const { return connected_; }
  [[nodiscard]] int descriptor() const { return fd_; }
  void send(std::string_view text) const {
    while (!text.empty()) {
      const ssize_t sent = ::send(fd_, text.data(), text.size(), MSG_NOSIGNAL);
      if (sent <= 0) return;  // the server has hung up; what it said can still be read
      text.remove_prefix(static_cast<std::size_t>(sent));
    }
  }
  /// Reads until `mark` was seen, the server closed, or patience ended.
  [[nodiscard]] std::string read_until(std::string_view mark) const {
    std::string text;
    char buffer[4096];
    while (mark.empty() || text.find(mark) == std::string::npos) {
      const ssize_t got = ::recv(fd_, buffer, sizeof buffer, 0);
      if (got <= 0) break;
      text.append(buffer, static_cast<std::size_t>(got));
    }
    return text;
  }

 private:
  int fd_;
  bool connected_ = false;
};

/// A request on a connection that ends with it. `head` holds further header lines, each with its CRLF.
[[nodiscard]] inline std::string http_request(const std::string& method, const std::string& target,
                                              const std::string& head, const std::string& body) {
  return method + " " + target + " HTTP/1.1\r\nHost: localhost\r\nConnection: close\r\n" + head +
         (body.empty() ? "" : "Content-Length: " + std::to_string(body.size()) + "\r\n") + "\r\n" + body;
}

/// The whole answer to one request on a connection of its own.
[[nodiscard]] inline std::string http_ask(std::uint16_t port, const std::string& method, const std::string& target,
                                          const std::string& head = {}, const std::string& body = {}) {
  const HttpClient client{port};
  client.send(http_request(method, target, head, body));
  return client.read_until("");
}

/// What follows the headers.
[[nodiscard]] inline std::string http_body(const std::string& answer) {
  const auto end = answer.find("\r\n\r\n");
  return end == std::string::npos ? std::string{} : answer.substr(end + 4);
}

}  // namespace telefab::test
