// SPDX-License-Identifier: GPL-3.0-or-later
#include <fmt/format.h>
#include <openssl/crypto.h>
#include <openssl/evp.h>
#include <openssl/hmac.h>

#include <algorithm>
#include <array>
#include <charconv>
#include <telefab/web/digest_login.hpp>

#include "lower_case.hpp"

namespace telefab {
namespace {

constexpr std::size_t kLongestParameter = 1024;
constexpr std::size_t kIssueDigits = 16;
constexpr std::size_t kSealDigits = 32;

std::string hex_of(const unsigned char* bytes, std::size_t size) {
  std::string text;
  for (std::size_t i = 0; i < size; ++i) text += fmt::format("{:02x}", bytes[i]);
  return text;
}

/// Empty where the library has no such hash (MD5 under FIPS).
std::string hash_of(const EVP_MD* kind, std::string_view text) {
  std::array<unsigned char, EVP_MAX_MD_SIZE> out{};
  unsigned int size = 0;
  if (EVP_Digest(text.data(), text.size(), out.data(), &size, kind, nullptr) != 1) return {};
  return hex_of(out.data(), size);
}

std::string seal_of(std::string_view secret, std::string_view text) {
  std::array<unsigned char, EVP_MAX_MD_SIZE> out{};
  unsigned int size = 0;
  HMAC(EVP_sha256(), secret.data(), static_cast<int>(secret.size()),
       reinterpret_cast<const unsigned char*>(text.data()), text.size(), out.data(), &size);
  return hex_of(out.data(), size).substr(0, kSealDigits);
}

bool are_equal(std::string_view a, std::string_view b) {
  return a.size() == b.size() && CRYPTO_memcmp(a.data(), b.data(), a.size()) == 0;
}

template <class Number>
std::optional<Number> hex_number(std::string_view text, std::size_t digits) {
  Number value{};
  if (text.size() != digits) return std::nullopt;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value, 16);
  if (error != std::errc{} || end != text.data() + text.size()) return std::nullopt;
  return value;
}

struct Parameter {
  std::string_view name;
  std::string DigestAnswer::*field;
};
constexpr std::array kParameters{
    Parameter{"username", &DigestAnswer::user},     Parameter{"realm", &DigestAnswer::realm},
    Parameter{"nonce", &DigestAnswer::nonce},       Parameter{"uri", &DigestAnswer::uri},
    Parameter{"response", &DigestAnswer::response}, Parameter{"algorithm", &DigestAnswer::algorithm},
    Parameter{"cnonce", &DigestAnswer::cnonce},     Parameter{"nc", &DigestAnswer::count},
    Parameter{"qop", &DigestAnswer::qop},
};

tl::unexpected<Error> malformed(const char* what) {
  return fail(ErrorCode::InvalidInput, fmt::format("Authorization: Digest: {}", what));
}

/// Takes one value, quoted or not, off the front of `rest`.
Result<std::string> take_value(std::string_view& rest) {
  std::string value;
  if (rest.starts_with('"')) {
    std::size_t at = 1;
    for (; at < rest.size() && rest[at] != '"'; ++at) {
      if (rest[at] == '\\' && ++at == rest.size()) break;
      value += rest[at];
    }
    if (at >= rest.size()) return malformed("a quoted value has no end");
    rest.remove_prefix(at + 1);
  } else {
    const auto end = std::min(rest.find_first_of(", \t"), rest.size());
    value = rest.substr(0, end);
    if (value.empty()) return malformed("a parameter has no value");
    rest.remove_prefix(end);
  }
  if (value.size() > kLongestParameter) return malformed("a value is too long");
  return value;
}

void skip_blanks(std::string_view& rest) { rest.remove_prefix(std::min(rest.find_first_not_of(" \t"), rest.size())); }

}  // namespace

DigestKeys digest_keys_of(std::string_view user, std::string_view password) {
  const std::string a1 = fmt::format("{}:{}:{}", user, DigestLogin::kRealm, password);
  return {hash_of(EVP_md5(), a1), hash_of(EVP_sha256(), a1)};
}

Result<DigestAnswer> digest_answer_from(std::string_view parameters) {
  DigestAnswer answer;
  std::vector<std::string> seen;
  std::string_view rest = parameters;
  for (skip_blanks(rest); !rest.empty(); skip_blanks(rest)) {
    if (!seen.empty()) {
      if (!rest.starts_with(',')) return malformed("parameters are not parted by commas");
      rest.remove_prefix(1);
      skip_blanks(rest);
    }
    const auto equals = rest.find('=');
    if (equals == std::string_view::npos || equals == 0) return malformed("a parameter has no value");
    const std::string name = lower(rest.substr(0, rest.find_first_of(" \t=")));
    rest.remove_prefix(equals + 1);
    skip_blanks(rest);
    auto value = take_value(rest);
    if (!value) return tl::unexpected{std::move(value.error())};
    if (std::ranges::find(seen, name) != seen.end()) return malformed("a parameter stands there twice");
    seen.push_back(name);
    const auto known = std::ranges::find(kParameters, std::string_view{name}, &Parameter::name);
    if (known != kParameters.end()) answer.*(known->field) = std::move(*value);
  }
  if (answer.user.empty() || answer.nonce.empty() || answer.uri.empty() || answer.response.empty())
    return malformed("username, nonce, uri or response is missing");
  return answer;
}

std::vector<std::string> DigestLogin::challenges(bool is_stale) {
  if (secret_.empty()) return {};
  const std::string issue = fmt::format("{:016x}{:016x}", static_cast<std::uint64_t>(clock_.now().count()), ++serial_);
  const std::string nonce = issue + seal_of(secret_, issue);
  std::vector<std::string> list;
  // One nonce for both: clients that read the two as one header mix them.
  for (const char* algorithm : {"SHA-256", "MD5"})
    list.push_back(fmt::format(R"(Digest realm="{}", qop="auth", algorithm={}, nonce="{}"{})", kRealm, algorithm, nonce,
                               is_stale ? ", stale=true" : ""));
  return list;
}

std::optional<Nanoseconds> DigestLogin::issued_at(std::string_view nonce) const {
  if (nonce.size() != 2 * kIssueDigits + kSealDigits) return std::nullopt;
  if (!are_equal(nonce.substr(2 * kIssueDigits), seal_of(secret_, nonce.substr(0, 2 * kIssueDigits))))
    return std::nullopt;
  const auto time = hex_number<std::uint64_t>(nonce.substr(0, kIssueDigits), kIssueDigits);
  if (!time) return std::nullopt;
  return Nanoseconds{static_cast<std::int64_t>(*time)};
}

bool DigestLogin::take_count(const DigestAnswer& answer, Nanoseconds issued, bool is_whole) {
  const auto count = hex_number<std::uint32_t>(answer.count, 8);
  if (!count || *count == 0) return false;
  const auto found = used_.find(answer.nonce);
  if (found == used_.end() ? issued <= forgotten_until_ : *count <= found->second.count) return false;
  if (!is_whole) return true;
  if (found == used_.end() && used_.size() >= kMostNonces) {
    std::erase_if(used_, [&](const auto& each) { return clock_.now() - each.second.issued > kNonceLasts; });
    if (used_.size() >= kMostNonces) {
      const auto oldest = std::ranges::min_element(used_, {}, [](const auto& each) { return each.second.issued; });
      forgotten_until_ = std::max(forgotten_until_, oldest->second.issued);
      used_.erase(oldest);
    }
  }
  used_.insert_or_assign(answer.nonce, Used{*count, issued});
  return true;
}

DigestLogin::Verdict DigestLogin::judge(const WebRequest& request, const DigestAnswer& answer, const DigestKeys* keys) {
  const std::string algorithm = lower(answer.algorithm);
  const bool is_sha256 = algorithm == "sha-256";
  // What was not offered: other algorithms, their sessions, no qop at all (RFC 2069), which counts no uses.
  if ((!is_sha256 && !algorithm.empty() && algorithm != "md5") || secret_.empty() || answer.qop != "auth" ||
      answer.cnonce.empty() || answer.uri != (request.sent_target.empty() ? request.target : request.sent_target))
    return Verdict::Wrong;
  const EVP_MD* kind = is_sha256 ? EVP_sha256() : EVP_md5();
  static const DigestKeys kNobody = digest_keys_of("", "");
  const DigestKeys& known = keys != nullptr ? *keys : kNobody;
  const std::string& a1 = is_sha256 ? known.sha256 : known.md5;
  const std::string a2 = hash_of(kind, request.method + ":" + answer.uri);
  const std::string wanted =
      hash_of(kind, fmt::format("{}:{}:{}:{}:auth:{}", a1, answer.nonce, answer.count, answer.cnonce, a2));
  const bool is_right = are_equal(wanted, answer.response);
  if (keys == nullptr || a1.empty() || wanted.empty() || !is_right) return Verdict::Wrong;
  const auto issued = issued_at(answer.nonce);
  if (request.goes_on) return issued ? Verdict::Right : Verdict::Stale;
  const Nanoseconds lasts = request.is_whole ? kNonceLasts : kNonceLasts - kLongestRequest;
  if (!issued || clock_.now() - *issued > lasts || !take_count(answer, *issued, request.is_whole))
    return Verdict::Stale;
  return Verdict::Right;
}

}  // namespace telefab
