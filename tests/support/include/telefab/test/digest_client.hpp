// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <fmt/format.h>

#include <span>
#include <string>
#include <string_view>
#include <telefab/base/digest.hpp>

namespace telefab::test {

/// The client's half of an HTTP digest login, written from RFC 7616 alone.
struct DigestClient {
  std::string user, password;
  std::string realm = "Telefab";
  std::string algorithm = "SHA-256";

  [[nodiscard]] std::string hash(std::string_view text) const {
    const auto bytes = std::as_bytes(std::span{text});
    return algorithm == "MD5" ? md5_hex(bytes) : to_hex(digest_of(bytes));
  }

  /// The Authorization header that answers a nonce.
  [[nodiscard]] std::string answer(std::string_view method, std::string_view uri, std::string_view nonce,
                                   std::string_view count = "00000001") const {
    const std::string a1 = hash(fmt::format("{}:{}:{}", user, realm, password));
    const std::string a2 = hash(fmt::format("{}:{}", method, uri));
    const std::string response = hash(fmt::format("{}:{}:{}:0a4f113b:auth:{}", a1, nonce, count, a2));
    return fmt::format(
        R"(Digest username="{}", realm="{}", nonce="{}", uri="{}", algorithm={}, qop=auth, nc={}, cnonce="0a4f113b", response="{}")",
        user, realm, nonce, uri, algorithm, count, response);
  }

  /// The nonce of a WWW-Authenticate header, or of an answer that has one; empty: there is none.
  [[nodiscard]] static std::string nonce_of(std::string_view challenge) {
    constexpr std::string_view kMark = "nonce=\"";
    const auto at = challenge.find(kMark);
    if (at == std::string_view::npos) return {};
    challenge.remove_prefix(at + kMark.size());
    return std::string{challenge.substr(0, challenge.find('"'))};
  }
};

}  // namespace telefab::test
