// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <filesystem>
#include <functional>
#include <map>
#include <optional>
#include <string>
#include <telefab/base/clock.hpp>
#include <telefab/web/digest_login.hpp>
#include <telefab/web/operator_tokens.hpp>
#include <telefab/web/web_message.hpp>
#include <tl/expected.hpp>
#include <vector>

namespace telefab {

struct SignInOptions {
  std::filesystem::path tokens = {};    ///< the operators' own; where there is such a file, everybody signs in
  std::string shared_token = {};        ///< counts while nobody has to sign in, and names nobody; empty: there is none
  bool is_shown_beyond = false;         ///< from other machines too: everybody signs in
  std::filesystem::path page_key = {};  ///< of the newest link (page_link.hpp), which opens what the shared token does
};

/// Something that a visitor did which the audit log is to know.
struct SignInEvents {
  std::function<void(std::string_view who, std::string_view what)> noted;
  /// Somebody showed what opens nothing. `address`: of the visitor, HOST:PORT.
  std::function<void(const std::string& address, const Error& why)> refused;
};

/// Decides who comes in at a page: by a client certificate, by a token in the head of a request, by HTTP digest login
/// with such a token as the password (of whom it was made for so; of the user "web" the shared one), or by the session
/// that a token or a link began. Sessions are cookies that scripts cannot read and other sites do not send; they end
/// after twelve hours, at the sign-out, with their token, and with the daemon. Threads: the page's.
class SignIn {
 public:
  static constexpr Nanoseconds kSessionLasts = std::chrono::hours{12};

  /// The clock must outlive it.
  SignIn(SignInOptions options, const Clock& clock, SignInEvents events = {});

  struct Refusal {
    unsigned status = 401;  ///< or 403: known, and still not allowed
    std::string what;
    bool is_stale = false;  ///< the password was right, and a new challenge is needed
  };
  /// Who asks, where that is enough for `needed`. What is shown and wrong is refused even where nothing is needed, but
  /// for a session that has ended.
  [[nodiscard]] tl::expected<Visitor, Refusal> admit(const WebRequest& request, Access needed);

  /// What WWW-Authenticate says to a program that can log in by digest. Not for a page: its browser would ask for a
  /// password.
  [[nodiscard]] std::vector<std::string> challenges(const Refusal& refusal) {
    return digest_.challenges(refusal.is_stale);
  }

  /// {"name":...,"may":...,"must_sign_in":...,"by":"session"|"token"|"digest"|"certificate"|null}: what a page asks
  /// first.
  [[nodiscard]] WebResponse session(const WebRequest& request);
  /// Begins a session by {"token":"..."} or, once, by {"link":"..."}.
  [[nodiscard]] WebResponse sign_in(const WebRequest& request);
  /// Ends it, if there is one.
  [[nodiscard]] WebResponse sign_out(const WebRequest& request);
  /// Whether nobody sees a part here without saying who it is.
  [[nodiscard]] bool must_sign_in();

 private:
  struct Session {
    Visitor visitor;
    Digest token;  ///< of the operator's token as the file has it; all zero: the shared one
    Nanoseconds ends{};
  };
  /// The file's tokens as they are now. On failure there are none, and nobody's counts.
  void refresh();
  /// Who shows this token; nothing: nobody.
  [[nodiscard]] std::optional<Session> by_token(std::string_view token);
  /// Of whom holds the shared token.
  [[nodiscard]] Session shared_session() const;
  /// The session that the key of a link opens, this once.
  [[nodiscard]] tl::expected<Session, WebResponse> by_link(const std::string& key, const std::string& address);
  [[nodiscard]] WebResponse begin(const WebRequest& request, Session session, std::string_view what);
  [[nodiscard]] std::optional<Visitor> by_cookie(const WebRequest& request);
  [[nodiscard]] tl::expected<Visitor, Refusal> by_digest(const WebRequest& request, const DigestAnswer& shown);
  [[nodiscard]] tl::expected<Visitor, Refusal> identify(const WebRequest& request);
  [[nodiscard]] WebResponse describe(const Visitor& visitor, const char* by);

  SignInOptions options_;
  const Clock& clock_;
  SignInEvents events_;
  DigestLogin digest_;
  std::vector<OperatorToken> tokens_;
  std::string stamp_;  ///< of the file that was read
  bool has_file_ = false;
  std::map<std::string, Session> sessions_;  ///< by the digest of what the cookie holds
};

}  // namespace telefab
