// SPDX-License-Identifier: GPL-3.0-or-later
#include <fmt/format.h>
#include <openssl/crypto.h>
#include <unistd.h>

#include <cerrno>
#include <charconv>
#include <optional>
#include <span>
#include <telefab/base/digest.hpp>
#include <telefab/base/file.hpp>
#include <telefab/base/secret.hpp>
#include <telefab/web/operator_tokens.hpp>
#include <telefab/web/page_link.hpp>

namespace telefab {
namespace {

struct KeptKey {
  Digest digest;
  std::int64_t ends_unix_s = 0;
};

Digest digest_of_key(std::string_view key) { return digest_of(std::as_bytes(std::span{key})); }

std::int64_t seconds_of(Nanoseconds wall) { return std::chrono::duration_cast<std::chrono::seconds>(wall).count(); }

/// DIGEST ENDS
std::optional<KeptKey> kept_key_from(std::string_view text) {
  const auto space = text.find(' ');
  if (space == std::string_view::npos || !text.ends_with('\n')) return std::nullopt;
  const auto digest = digest_from_hex(text.substr(0, space));
  KeptKey kept{digest.value_or(Digest{}), 0};
  const char* const end = text.data() + text.size() - 1;
  const auto number = std::from_chars(text.data() + space + 1, end, kept.ends_unix_s);
  if (!digest || number.ec != std::errc{} || number.ptr != end) return std::nullopt;
  return kept;
}

}  // namespace

Result<std::string> make_page_key(const std::filesystem::path& file, Nanoseconds wall) {
  auto key = random_token();
  if (!key) return key;
  const std::string kept = fmt::format("{} {}\n", to_hex(digest_of_key(*key)),
                                       seconds_of(wall) + std::chrono::seconds{kPageLinkLasts}.count());
  if (auto written = write_secret(file, kept); !written) return tl::unexpected{written.error()};
  return key;
}

Result<void> take_page_key(const std::filesystem::path& file, std::string_view key, Nanoseconds wall) {
  const auto text = read_secret(file);
  if (!text) return tl::unexpected{text.error()};
  const auto kept = kept_key_from(*text);
  if (!kept) return fail(ErrorCode::InvalidInput, fmt::format("{} is damaged; have a new link made", file.string()));
  const Digest shown = digest_of_key(key);
  if (CRYPTO_memcmp(shown.bytes.data(), kept->digest.bytes.data(), shown.bytes.size()) != 0)
    return fail(ErrorCode::NotTrusted, "this is not the key of the newest link");
  // Taken first: what cannot be removed could be shown again.
  if (::unlink(file.c_str()) != 0)
    return errno == ENOENT ? fail(ErrorCode::NotFound, "this link is used") : fail_system("remove", file, errno);
  // A clock that was set back makes no link last longer.
  const std::int64_t left_s = kept->ends_unix_s - seconds_of(wall);
  if (left_s <= 0 || left_s > std::chrono::seconds{kPageLinkLasts}.count())
    return fail(ErrorCode::NotTrusted, "this link is too old");
  return {};
}

std::string page_link(std::string_view address, std::string_view key) {
  return fmt::format("{}/#sign-in={}", address, key);
}

}  // namespace telefab
