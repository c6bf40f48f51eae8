// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <cstdint>
#include <filesystem>
#include <memory>
#include <string>
#include <string_view>

namespace telefab::test {

/// One connection to an HTTPS server on loopback, of a holder of the certificate `name` in `folder`, or of nobody's;
/// for tests only. It believes whatever the server shows.
class HttpsClient {
 public:
  explicit HttpsClient(std::uint16_t port, const std::filesystem::path& folder = {}, const std::string& name = {});
  ~HttpsClient();
  [[nodiscard]] bool connected() const;
  void send(std::string_view text) const;
  /// Reads until `mark` was seen, the server closed, or patience ended.
  [[nodiscard]] std::string read_until(std::string_view mark) const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

/// The whole answer to one request on a connection of its own, as http_ask.
[[nodiscard]] std::string https_ask(const HttpsClient& client, const std::string& method, const std::string& target,
                                    const std::string& head = {}, const std::string& body = {});

}  // namespace telefab::test
