// SPDX-License-Identifier: GPL-3.0-or-later
#include <fmt/format.h>
#include <openssl/crypto.h>
#include <sys/stat.h>

#include <algorithm>
#include <cctype>
#include <nlohmann/json.hpp>
#include <optional>
#include <telefab/base/json_text.hpp>
#include <telefab/web/page_link.hpp>
#include <telefab/web/sign_in.hpp>

#include "lower_case.hpp"

namespace telefab {
namespace {

constexpr std::size_t kMostSessions = 256;
constexpr std::string_view kBearer = "Bearer ";
constexpr std::string_view kDigest = "digest ";
constexpr std::string_view kSharedName = "web";  // of who has shown no name of his own

bool are_equal(std::string_view a, std::string_view b) {
  return a.size() == b.size() && CRYPTO_memcmp(a.data(), b.data(), a.size()) == 0;
}

/// Cookies know no ports, so that two daemons of one machine would take each other's for their own.
std::string cookie_name(const WebRequest& request) {
  const auto colon = request.host.rfind(':');
  const bool has_port = colon != std::string::npos && request.host.find(']', colon) == std::string::npos;
  std::string name = "telefab";
  if (has_port && std::all_of(request.host.begin() + static_cast<std::ptrdiff_t>(colon) + 1, request.host.end(),
                              [](unsigned char c) { return std::isdigit(c); }))
    name += "-" + request.host.substr(colon + 1);
  return name;
}

/// The value of a cookie; empty where it was not sent.
std::string_view cookie_of(const WebRequest& request) {
  const std::string name = cookie_name(request) + "=";
  for (std::string_view rest = request.cookie; !rest.empty();) {
    while (rest.starts_with(' ')) rest.remove_prefix(1);
    const auto end = std::min(rest.find(';'), rest.size());
    if (rest.substr(0, end).starts_with(name)) return rest.substr(name.size(), end - name.size());
    rest.remove_prefix(std::min(end + 1, rest.size()));
  }
  return {};
}

std::string set_cookie(const WebRequest& request, std::string_view value, std::int64_t seconds) {
  return fmt::format("{}={}; Max-Age={}; Path=/; HttpOnly; SameSite=Strict{}", cookie_name(request), value, seconds,
                     request.is_encrypted ? "; Secure" : "");
}

std::string key_of(std::string_view cookie) { return to_hex(digest_of(std::as_bytes(std::span{cookie}))); }

bool is_change(const WebRequest& request) { return request.method != "GET" && request.method != "HEAD"; }

/// Whether a browser sent this from a page of ours. Ports count: a page of another server on this machine is foreign.
bool is_from_here(const WebRequest& request) {
  const std::string_view scheme = request.origin.starts_with("https://") ? "https://" : "http://";
  return request.origin.starts_with(scheme) && (!request.is_encrypted || scheme == "https://") &&
         lower(request.origin.substr(scheme.size())) == lower(request.host);
}

/// Changes whenever the file is another: a writer renames, so the inode is new.
std::string stamp_of(const std::filesystem::path& file) {
  struct stat status {};
  if (::stat(file.c_str(), &status) != 0) return {};
  return fmt::format("{} {} {} {} {:o} {}", status.st_ino, status.st_mtim.tv_sec, status.st_mtim.tv_nsec,
                     status.st_size, status.st_mode, status.st_uid);
}

tl::unexpected<SignIn::Refusal> refuse(unsigned status, std::string what) {
  return tl::unexpected{SignIn::Refusal{status, std::move(what)}};
}

WebResponse answer_of(const SignIn::Refusal& refusal) {
  return web_problem(refusal.status, "not-permitted", refusal.what);
}

constexpr const char* kForeign = "this was sent by a page of somebody else, so it is not carried out";

}  // namespace

SignIn::SignIn(SignInOptions options, const Clock& clock, SignInEvents events)
    : options_{std::move(options)},
      clock_{clock},
      events_{std::move(events)},
      digest_{random_token().value_or(std::string{}), clock} {
  if (!events_.noted) events_.noted = [](std::string_view, std::string_view) {};
  if (!events_.refused) events_.refused = [](const std::string&, const Error&) {};
  refresh();
}

void SignIn::refresh() {
  if (options_.tokens.empty()) return;
  const std::string stamp = stamp_of(options_.tokens);
  if (stamp == stamp_) return;
  stamp_ = stamp;
  has_file_ = !stamp.empty();
  tokens_.clear();
  if (!has_file_) return;
  if (auto read = read_operator_tokens(options_.tokens))
    tokens_ = std::move(*read);
  else
    events_.refused("page", read.error());
}

bool SignIn::must_sign_in() {
  refresh();
  return options_.is_shown_beyond || has_file_;
}

std::optional<SignIn::Session> SignIn::by_token(std::string_view token) {
  const bool is_required = must_sign_in();
  if (const OperatorToken* owner = owner_of(tokens_, token))
    return Session{{owner->name, owner->may}, owner->digest, clock_.now() + kSessionLasts};
  if (!is_required && !options_.shared_token.empty() && are_equal(token, options_.shared_token))
    return shared_session();
  return std::nullopt;
}

SignIn::Session SignIn::shared_session() const {
  return {{std::string{kSharedName}, Access::Operators}, {}, clock_.now() + kSessionLasts};
}

tl::expected<SignIn::Session, WebResponse> SignIn::by_link(const std::string& key, const std::string& address) {
  if (must_sign_in())
    return tl::unexpected{web_problem(
        401, "not-permitted", "links open nothing here: operators sign in with tokens of their own (tokens add NAME)")};
  if (options_.page_key.empty()) return tl::unexpected{web_problem(401, "not-permitted", "links open nothing here")};
  const auto taken = take_page_key(options_.page_key, key, clock_.wall());
  if (taken) return shared_session();
  if (taken.error().code == ErrorCode::StorageFailed || taken.error().code == ErrorCode::NotPermitted)
    return tl::unexpected{web_problem(taken.error())};
  events_.refused(address, {ErrorCode::NotTrusted, "the page: a link that opens nothing: " + taken.error().what});
  return tl::unexpected{web_problem(401, "not-permitted",
                                    fmt::format("this link opens nothing any more: each opens once, within {} minutes; "
                                                "the daemon's verb `page-link` prints another",
                                                kPageLinkLasts.count()))};
}

std::optional<Visitor> SignIn::by_cookie(const WebRequest& request) {
  const std::string_view cookie = cookie_of(request);
  if (cookie.empty()) return std::nullopt;
  const auto found = sessions_.find(key_of(cookie));
  if (found == sessions_.end()) return std::nullopt;
  const Session& session = found->second;
  const bool is_shared = session.token == Digest{};
  const bool still_opens = is_shared ? !must_sign_in() : std::ranges::any_of(tokens_, [&](const OperatorToken& token) {
    return token.name == session.visitor.name && token.digest == session.token;
  });
  if (still_opens && clock_.now() < session.ends) return session.visitor;
  sessions_.erase(found);
  return std::nullopt;
}

tl::expected<Visitor, SignIn::Refusal> SignIn::by_digest(const WebRequest& request, const DigestAnswer& shown) {
  const auto named = std::ranges::find_if(
      tokens_, [&](const OperatorToken& token) { return token.digest_login.has_value() && token.name == shown.user; });
  std::optional<DigestKeys> keys;
  Visitor visitor;
  if (named != tokens_.end()) {
    keys = named->digest_login;
    visitor = {named->name, named->may};
  } else if (!must_sign_in() && !options_.shared_token.empty() && shown.user == kSharedName) {
    keys = digest_keys_of(kSharedName, options_.shared_token);
    visitor = {std::string{kSharedName}, Access::Operators};
  }
  switch (digest_.judge(request, shown, keys ? &*keys : nullptr)) {
    case DigestLogin::Verdict::Right:
      // A browser repeats it by itself, as it does a cookie.
      if (is_change(request) && !request.origin.empty() && !is_from_here(request)) return refuse(403, kForeign);
      return visitor;
    case DigestLogin::Verdict::Stale:
      return tl::unexpected{Refusal{401, "this login is too old or was used before: log in again", true}};
    case DigestLogin::Verdict::Wrong:
      break;
  }
  if (request.is_whole)
    events_.refused(request.address, {ErrorCode::NotTrusted, "the page: a digest login that is nobody's"});
  return refuse(401,
                "this user and password open nothing here: the password of the user NAME is the token that the verb "
                "`tokens add NAME --digest` made");
}

tl::expected<Visitor, SignIn::Refusal> SignIn::identify(const WebRequest& request) {
  refresh();
  if (request.authorization.starts_with(kBearer)) {
    if (const auto owner = by_token(std::string_view{request.authorization}.substr(kBearer.size())))
      return owner->visitor;
    if (request.is_whole)
      events_.refused(request.address, {ErrorCode::NotTrusted, "the page: a token that is nobody's"});
    return refuse(401, "this token is nobody's here, or no longer");
  }
  // Another scheme or realm is a proxy's own affair.
  if (lower(std::string_view{request.authorization}.substr(0, kDigest.size())) == kDigest) {
    const auto shown = digest_answer_from(std::string_view{request.authorization}.substr(kDigest.size()));
    if (!shown) return refuse(401, shown.error().what);
    if (shown->realm == DigestLogin::kRealm) return by_digest(request, *shown);
  }
  // A browser adds cookies and certificates by itself, whoever wrote the page that asks.
  if (const auto visitor = by_cookie(request)) {
    if (is_change(request) && !is_from_here(request)) return refuse(403, kForeign);
    return *visitor;
  }
  if (request.certified) {
    if (is_change(request) && !request.origin.empty() && !is_from_here(request)) return refuse(403, kForeign);
    return *request.certified;
  }
  return Visitor{{}, must_sign_in() ? Access::Anybody : Access::Readers};
}

tl::expected<Visitor, SignIn::Refusal> SignIn::admit(const WebRequest& request, Access needed) {
  if (needed == Access::Anybody) return Visitor{};
  auto visitor = identify(request);
  if (!visitor || visitor->may >= needed) return visitor;
  if (!visitor->name.empty())
    return refuse(403, fmt::format("{} may not do this: signed in for {}", visitor->name, name_of(visitor->may)));
  return refuse(401, must_sign_in()
                         ? "sign in first: on the page with a token of your own (the daemon's verb "
                           "`tokens add NAME` makes one), by Authorization: Bearer TOKEN or X-Api-Key: TOKEN, "
                           "or over TLS with a client certificate"
                         : "sign in first: the daemon's verb `page-link` prints a link that does; a program shows "
                           "the operator's token: Authorization: Bearer TOKEN, or X-Api-Key: TOKEN (file web-token "
                           "in the daemon's data folder)");
}

WebResponse SignIn::describe(const Visitor& visitor, const char* by) {
  const auto name = visitor.name.empty() ? nlohmann::ordered_json{} : nlohmann::ordered_json(visitor.name);
  const nlohmann::ordered_json value{{"name", name},
                                     {"may", name_of(visitor.may)},
                                     {"must_sign_in", must_sign_in()},
                                     {"by", by != nullptr ? nlohmann::ordered_json(by) : nlohmann::ordered_json{}}};
  return {200, "application/json", json_text(value)};
}

WebResponse SignIn::session(const WebRequest& request) {
  const auto visitor = identify(request);
  if (!visitor) return answer_of(visitor.error());
  if (visitor->name.empty()) return describe(*visitor, nullptr);
  if (request.authorization.starts_with(kBearer)) return describe(*visitor, "token");
  if (by_cookie(request)) return describe(*visitor, "session");
  return describe(*visitor, request.certified ? "certificate" : "digest");
}

WebResponse SignIn::sign_in(const WebRequest& request) {
  if (!request.origin.empty() && !is_from_here(request)) return web_problem(403, "not-permitted", kForeign);
  const auto body = json_or_discarded(request.body);
  const auto text_of = [&](const char* name) {
    const auto found = body.is_object() ? body.find(name) : body.end();
    return body.is_object() && found != body.end() && found->is_string() ? std::optional{found->get<std::string>()}
                                                                         : std::nullopt;
  };
  const auto token = text_of("token"), link = text_of("link");
  if (token.has_value() == link.has_value())
    return web_problem(400, "invalid-input", R"(the body is {"token":"..."} or {"link":"..."})");
  if (link) {
    auto session = by_link(*link, request.address);
    return session ? begin(request, std::move(*session), "signed in at the page by a link") : session.error();
  }
  if (auto session = by_token(*token)) return begin(request, std::move(*session), "signed in at the page");
  events_.refused(request.address, {ErrorCode::NotTrusted, "the page: a sign-in with a token that is nobody's"});
  return web_problem(401, "not-permitted", "this token is nobody's here, or no longer");
}

WebResponse SignIn::begin(const WebRequest& request, Session session, std::string_view what) {
  const auto cookie = random_token();
  if (!cookie) return web_problem(cookie.error());
  std::erase_if(sessions_, [&](const auto& each) { return each.second.ends <= clock_.now(); });
  if (sessions_.size() >= kMostSessions)
    sessions_.erase(std::ranges::min_element(sessions_, {}, [](const auto& each) { return each.second.ends; }));
  const Visitor visitor = session.visitor;
  sessions_.insert_or_assign(key_of(*cookie), std::move(session));
  events_.noted(visitor.name, what);
  WebResponse response = describe(visitor, "session");
  response.cookie =
      set_cookie(request, *cookie, std::chrono::duration_cast<std::chrono::seconds>(kSessionLasts).count());
  return response;
}

WebResponse SignIn::sign_out(const WebRequest& request) {
  if (!request.origin.empty() && !is_from_here(request)) return web_problem(403, "not-permitted", kForeign);
  if (const auto visitor = by_cookie(request)) {
    events_.noted(visitor->name, "signed out at the page");
    sessions_.erase(key_of(cookie_of(request)));
  }
  WebResponse response = describe({{}, must_sign_in() ? Access::Anybody : Access::Readers}, nullptr);
  response.cookie = set_cookie(request, "", 0);
  // Pictures of parts that the browser kept.
  response.headers.emplace_back("Clear-Site-Data", "\"cache\"");
  return response;
}

}  // namespace telefab
