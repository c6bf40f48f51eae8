// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <cstdint>
#include <map>
#include <optional>
#include <string>
#include <string_view>
#include <telefab/base/clock.hpp>
#include <telefab/base/result.hpp>
#include <telefab/web/web_message.hpp>
#include <vector>

namespace telefab {

/// What a digest login of one user is checked by, H(A1) of RFC 7616 in hexadecimal: of user, realm and password. Who
/// has it can log in by digest as the user, so it is a secret like a key; the password itself does not follow from it.
struct DigestKeys {
  std::string md5;
  std::string sha256;
  friend bool operator==(const DigestKeys&, const DigestKeys&) = default;
};

/// The keys of a user and a password in the realm of Telefab's pages.
[[nodiscard]] DigestKeys digest_keys_of(std::string_view user, std::string_view password);

/// What follows "Digest " in an Authorization header.
struct DigestAnswer {
  std::string user, realm, nonce, uri, response, algorithm, cnonce, count, qop;
};
/// InvalidInput: not parameters of RFC 7616, or one of them twice.
[[nodiscard]] Result<DigestAnswer> digest_answer_from(std::string_view parameters);

/// HTTP digest login (RFC 7616: MD5 and SHA-256, qop auth), for programs that log in by user and password. A nonce is
/// this object's own, lasts half an hour and counts its uses, so that what was overheard opens nothing a second time.
/// Only logins that succeeded take memory. Threads: one at a time.
class DigestLogin {
 public:
  static constexpr std::string_view kRealm = "Telefab";
  static constexpr Nanoseconds kNonceLasts = std::chrono::minutes{30};
  /// A request whose head came before the nonce's last minutes may still be judged whole.
  static constexpr Nanoseconds kLongestRequest = std::chrono::minutes{11};
  static constexpr std::size_t kMostNonces = 1024;

  /// The clock must outlive it. `secret` makes its nonces; nobody else's are taken, and without one nobody logs in.
  DigestLogin(std::string secret, const Clock& clock) : secret_{std::move(secret)}, clock_{clock} {}

  /// The values of WWW-Authenticate, the stronger first, both with one new nonce.
  [[nodiscard]] std::vector<std::string> challenges(bool is_stale);

  enum class Verdict : std::uint8_t {
    Right,
    Stale,  ///< the password is right; the nonce is old, used or of another start: a new challenge answers it
    Wrong,
  };
  /// Judges an answer by the user's keys (null: there is no such user; it takes as long). A request that is whole uses
  /// its count up; its head alone does not. One whose answer goes on holds
  /// for as long as the password does.
  [[nodiscard]] Verdict judge(const WebRequest& request, const DigestAnswer& answer, const DigestKeys* keys);

 private:
  struct Used {
    std::uint32_t count = 0;
    Nanoseconds issued{};
  };
  /// When this object issued the nonce; nothing: it did not.
  [[nodiscard]] std::optional<Nanoseconds> issued_at(std::string_view nonce) const;
  [[nodiscard]] bool take_count(const DigestAnswer& answer, Nanoseconds issued, bool is_whole);

  std::string secret_;
  const Clock& clock_;
  std::uint64_t serial_ = 0;
  std::map<std::string, Used> used_;  ///< by nonce
  Nanoseconds forgotten_until_{-1};   ///< of nonces issued until then the counts are not known any more
};

}  // namespace telefab
