// SPDX-License-Identifier: GPL-3.0-or-later
#include <fmt/chrono.h>

#include <memory>
#include <telefab/command_line/output.hpp>
#include <telefab/service/shared_verbs.hpp>
#include <telefab/service/web_page.hpp>

namespace telefab {
namespace {

struct TokensOptions {
  std::string action, name, data;
  bool is_read_only = false, uses_digest = false;
};

Result<ExitCode> list(const std::filesystem::path& file) {
  const auto tokens = read_operator_tokens(file);
  if (!tokens && tokens.error().code != ErrorCode::NotFound) return tl::unexpected{tokens.error()};
  if (!tokens) write_note("no operator has a token here: whoever is on this machine sees the page\n");
  if (tokens)
    for (const OperatorToken& token : *tokens)
      write_output(fmt::format("{:<24} {:<10} since {:%Y-%m-%d %H:%M} UTC{}\n", token.name, name_of(token.may),
                               fmt::gmtime(static_cast<std::time_t>(token.made_unix_s)),
                               token.digest_login ? ", also by digest login" : ""));
  return ExitCode::Ok;
}

Result<ExitCode> run(const TokensOptions& o) {
  const auto file = operator_tokens_in(o.data);
  if (o.action == "list") {
    if (!o.name.empty() || o.is_read_only || o.uses_digest)
      return fail(ErrorCode::InvalidInput, "tokens list takes no NAME, no --read-only and no --digest");
    return list(file);
  }
  if (o.name.empty()) return fail(ErrorCode::InvalidInput, fmt::format("tokens {} takes a NAME", o.action));
  if (o.action == "add") {
    const auto token = add_operator_token(file, o.name, o.is_read_only ? Access::Readers : Access::Operators,
                                          SystemClock{}.wall(), o.uses_digest ? DigestUse::Yes : DigestUse::No);
    if (!token) return tl::unexpected{token.error()};
    write_note(fmt::format("the token of {}, shown only now; who has it is {} at the page:\n", o.name, o.name));
    write_output(*token + "\n");
    return ExitCode::Ok;
  }
  if (o.is_read_only || o.uses_digest)
    return fail(ErrorCode::InvalidInput, "tokens revoke takes neither --read-only nor --digest");
  if (auto done = revoke_operator_token(file, o.name); !done) return tl::unexpected{done.error()};
  write_output(fmt::format("the token of {} opens nothing from now on\n", o.name));
  return ExitCode::Ok;
}

}  // namespace

VerbBody declare_tokens(VerbOptions& options) {
  auto o = std::make_shared<TokensOptions>();
  options.add("ACTION", o->action, "add NAME: make a token and print it, once; list; revoke NAME")
      .required()
      .one_of({"add", "list", "revoke"});
  options.add("NAME", o->name, "whom the audit log names: letters, digits, -, _ and .");
  options.add("--data", o->data, "the daemon's folder").required();
  options.flag("--read-only", o->is_read_only, "it opens what the page shows and no command, e.g. for Prometheus");
  options.flag("--digest", o->uses_digest,
               "it is also the password of the user NAME for programs that log in by HTTP digest (PrusaLink); the file "
               "then keeps what such a login is checked by, which opens the same to who can read it");
  options.footer(
      "With the first token everybody signs in at the page, on this machine too: with it on the page, by "
      "Authorization: "
      "Bearer TOKEN, or by X-Api-Key: TOKEN; the token of DATA/web-token, which names nobody, opens nothing any more. "
      "A "
      "change holds at once, for sessions that are open too; no restart is needed. The file DATA/operator-tokens keeps "
      "salted digests; while it is there, nobody comes in without signing in, even after the last revoke.");
  return [o](std::stop_token) { return run(*o); };
}

}  // namespace telefab
