// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <openssl/ssl.h>

#include <filesystem>
#include <memory>
#include <string>
#include <telefab/test/http_client.hpp>

namespace telefab::test {

/// One connection to an HTTPS server on loopback, of a holder of the certificate `name` in `folder`, or of nobody's;
/// for tests only. It believes whatever the server shows.
class HttpsClient {
 public:
  explicit HttpsClient(std::uint16_t port, const std::filesystem::path& folder = {}, const std::string& name = {})
      : socket_{port}, context_{SSL_CTX_new(TLS_client_method())} {
    if (!name.empty()) {
      SSL_CTX_use_certificate_chain_file(context_.get(), (folder / (name + ".crt")).c_str());
      SSL_CTX_use_PrivateKey_file(context_.get(), (folder / (name + ".key")).c_str(), SSL_FILETYPE_PEM);
    }
    stream_.reset(SSL_new(context_.get()));
    SSL_set_fd(stream_.get(), socket_.descriptor());
    connected_ = SSL_connect(stream_.get()) == 1;
  }
  [[nodiscard]] bool connected() const { return connected_; }
  void send(std::string_view text) const {
    if (connected_) (void)SSL_write(stream_.get(), text.data(), static_cast<int>(text.size()));
  }
  /// Reads until `mark` was seen, the server closed, or patience ended.
  [[nodiscard]] std::string read_until(std::string_view mark) const {
    std::string text;
    char buffer[4096];
    while (connected_ && (mark.empty() || text.find(mark) == std::string::npos)) {
      const int got = SSL_read(stream_.get(), buffer, sizeof buffer);
      if (got <= 0) break;
      text.append(buffer, static_cast<std::size_t>(got));
    }
    return text;
  }

 private:
  struct Free {
    void operator()(SSL_CTX* context) const { SSL_CTX_free(context); }
    void operator()(SSL* stream) const { SSL_free(stream); }
  };
  HttpClient socket_;
  std::unique_ptr<SSL_CTX, Free> context_;
  std::unique_ptr<SSL, Free> stream_;
  bool connected_ = false;
};

/// The whole answer to one request on a connection of its own. `head` holds further header lines, each with its CRLF.
[[nodiscard]] inline std::string https_ask(const HttpsClient& client, const std::string& method,
                                           const std::string& target, const std::string& head = {},
                                           const std::string& body = {}) {
  client.send(method + " " + target + " HTTP/1.1\r\nHost: localhost\r\nConnection: close\r\n" + head +
              (body.empty() ? "" : "Content-Length: " + std::to_string(body.size()) + "\r\n") + "\r\n" + body);
  return client.read_until("");
}

}  // namespace telefab::test
