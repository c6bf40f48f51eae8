// SPDX-License-Identifier: GPL-3.0-or-later
#include <fcntl.h>
#include <fmt/format.h>
#include <openssl/crypto.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <charconv>
#include <optional>
#include <telefab/base/file.hpp>
#include <telefab/base/open_file.hpp>
#include <telefab/base/person_name.hpp>
#include <telefab/base/secret.hpp>
#include <telefab/web/operator_tokens.hpp>

namespace telefab {
namespace {

constexpr std::size_t kLongestName = 64;
constexpr std::size_t kFields = 5;
constexpr std::size_t kFieldsWithDigest = 7;
constexpr std::size_t kMd5Digits = 32, kSha256Digits = 64;

bool is_name(std::string_view text) { return is_person_name(text, "-_.", kLongestName); }

Digest digest_of_token(std::string_view salt, std::string_view token) {
  Hasher hasher;
  hasher.feed(salt);
  hasher.feed(token);
  return hasher.digest();
}

/// NAME ROLE SALT DIGEST MADE [MD5 SHA256]
std::string line_of(const OperatorToken& token) {
  const auto& keys = token.digest_login;
  return fmt::format("{} {} {} {} {}{}\n", token.name, name_of(token.may), token.salt, to_hex(token.digest),
                     token.made_unix_s, keys ? fmt::format(" {} {}", keys->md5, keys->sha256) : "");
}

bool is_hex(std::string_view text, std::size_t digits) {
  return text.size() == digits && text.find_first_not_of("0123456789abcdef") == std::string_view::npos;
}

std::optional<OperatorToken> token_from(std::string_view line) {
  std::array<std::string_view, kFieldsWithDigest> fields;
  const auto count = static_cast<std::size_t>(std::ranges::count(line, ' ')) + 1;
  if (count != kFields && count != kFieldsWithDigest) return std::nullopt;
  for (std::size_t i = 0; i < count; ++i) {
    const auto space = line.find(' ');
    fields[i] = line.substr(0, space);
    line.remove_prefix(std::min(fields[i].size() + 1, line.size()));
  }
  const auto digest = digest_from_hex(fields[3]);
  OperatorToken token{std::string{fields[0]}, Access::Operators, std::string{fields[2]}, digest.value_or(Digest{}), 0};
  if (fields[1] == name_of(Access::Readers))
    token.may = Access::Readers;
  else if (fields[1] != name_of(Access::Operators))
    return std::nullopt;
  const char* end = fields[4].data() + fields[4].size();
  const auto number = std::from_chars(fields[4].data(), end, token.made_unix_s);
  if (!digest || !is_name(token.name) || number.ec != std::errc{} || number.ptr != end) return std::nullopt;
  if (count == kFieldsWithDigest) {
    // A library without MD5 makes none of it.
    if ((!fields[5].empty() && !is_hex(fields[5], kMd5Digits)) || !is_hex(fields[6], kSha256Digits))
      return std::nullopt;
    token.digest_login = DigestKeys{std::string{fields[5]}, std::string{fields[6]}};
  }
  return token;
}

/// Keeps others from changing what the file holds for as long as it lives. Taken: the folder of the file. Fails with
/// NotFound, NotPermitted, StorageFailed, Conflict.
Result<OpenFile> keep_for_us(const std::filesystem::path& file) {
  constexpr auto kOthersEndWithin = std::chrono::seconds{10};
  const auto folder = file.has_parent_path() ? file.parent_path() : ".";
  OpenFile kept{::open(folder.c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC)};
  if (kept.get() < 0) return fail_system("open", folder, errno);
  const int held = take_lock(kept, kOthersEndWithin);
  if (held == EWOULDBLOCK)
    return fail(ErrorCode::Conflict, fmt::format("another program changes {}; try again later", file.string()));
  if (held != 0) return fail_system("lock", folder, held);
  return kept;
}

Result<void> write_tokens(const std::filesystem::path& file, std::span<const OperatorToken> tokens) {
  std::string text;
  for (const OperatorToken& token : tokens) text += line_of(token);
  return write_secret(file, text);
}

}  // namespace

Result<std::vector<OperatorToken>> read_operator_tokens(const std::filesystem::path& file) {
  const auto text = read_secret(file);
  if (!text) return tl::unexpected{text.error()};
  std::vector<OperatorToken> tokens;
  for (std::string_view rest = *text; !rest.empty();) {
    const auto end = std::min(rest.find('\n'), rest.size());
    auto token = token_from(rest.substr(0, end));
    if (!token)
      return fail(
          ErrorCode::InvalidInput,
          fmt::format(
              "{} line {}: not NAME ROLE SALT DIGEST MADE, with or without two keys of a digest login; remove the line",
              file.string(), tokens.size() + 1));
    tokens.push_back(std::move(*token));
    rest.remove_prefix(std::min(end + 1, rest.size()));
  }
  return tokens;
}

Result<std::string> add_operator_token(const std::filesystem::path& file, const std::string& name, Access may,
                                       Nanoseconds wall, DigestUse use) {
  // Those the daemon itself uses of who has shown no name of his own.
  if (!is_name(name) || name == "web" || name == "local")
    return fail(ErrorCode::InvalidInput,
                fmt::format("\"{}\" is not a name for an operator: up to {} bytes of letters, digits, -, _ and ., no "
                            "blank, and neither \"web\" nor \"local\"",
                            name, kLongestName));
  const auto kept = keep_for_us(file);
  if (!kept) return tl::unexpected{kept.error()};
  auto tokens = read_operator_tokens(file);
  if (!tokens && tokens.error().code != ErrorCode::NotFound) return tl::unexpected{tokens.error()};
  if (!tokens) tokens.emplace();
  if (std::ranges::find(*tokens, name, &OperatorToken::name) != tokens->end())
    return fail(ErrorCode::Conflict, fmt::format("{} has a token already: revoke it first", name));
  const auto salt = random_token();
  auto token = random_token();
  if (!salt || !token) return tl::unexpected{salt ? token.error() : salt.error()};
  OperatorToken made{name, may, *salt, digest_of_token(*salt, *token),
                     std::chrono::duration_cast<std::chrono::seconds>(wall).count()};
  if (use == DigestUse::Yes) made.digest_login = digest_keys_of(name, *token);
  tokens->push_back(std::move(made));
  if (auto written = write_tokens(file, *tokens); !written) return tl::unexpected{written.error()};
  return token;
}

Result<void> revoke_operator_token(const std::filesystem::path& file, const std::string& name) {
  const auto kept = keep_for_us(file);
  if (!kept) return tl::unexpected{kept.error()};
  auto tokens = read_operator_tokens(file);
  if (!tokens) return tl::unexpected{tokens.error()};
  if (std::erase_if(*tokens, [&](const OperatorToken& each) { return each.name == name; }) == 0)
    return fail(ErrorCode::NotFound, fmt::format("{} has no token in {}", name, file.string()));
  return write_tokens(file, *tokens);
}

const OperatorToken* owner_of(std::span<const OperatorToken> tokens, std::string_view token) {
  const OperatorToken* owner = nullptr;
  for (const OperatorToken& each : tokens) {
    const Digest shown = digest_of_token(each.salt, token);
    if (CRYPTO_memcmp(shown.bytes.data(), each.digest.bytes.data(), shown.bytes.size()) == 0) owner = &each;
  }
  return owner;
}

Result<std::string> random_token() { return random_hex(16); }

}  // namespace telefab
