// SPDX-License-Identifier: GPL-3.0-or-later
#include <openssl/evp.h>

#include <cstdlib>
#include <telefab/base/digest.hpp>

namespace telefab {

// libcrypto fails here only when memory is gone or the library is broken: a crash, not a Result.
static void require(bool ok) {
  if (!ok) std::abort();
}

struct Hasher::State {
  EVP_MD_CTX* context = EVP_MD_CTX_new();
  State() { require(context && EVP_DigestInit_ex(context, EVP_sha256(), nullptr) == 1); }
  ~State() { EVP_MD_CTX_free(context); }
  State(const State&) = delete;
  State& operator=(const State&) = delete;
};

Hasher::Hasher() : state_{std::make_unique<State>()} {}
Hasher::~Hasher() = default;
Hasher::Hasher(Hasher&&) noexcept = default;
Hasher& Hasher::operator=(Hasher&&) noexcept = default;

void Hasher::feed(std::span<const std::byte> bytes) {
  require(EVP_DigestUpdate(state_->context, bytes.data(), bytes.size()) == 1);
}
void Hasher::feed(std::string_view text) { feed(std::as_bytes(std::span{text})); }

Digest Hasher::digest() const {
  State copy;
  require(EVP_MD_CTX_copy_ex(copy.context, state_->context) == 1);
  Digest digest;
  require(EVP_DigestFinal_ex(copy.context, reinterpret_cast<unsigned char*>(digest.bytes.data()), nullptr) == 1);
  return digest;
}

Digest digest_of(std::span<const std::byte> bytes) {
  Hasher hasher;
  hasher.feed(bytes);
  return hasher.digest();
}

static std::string hex_of(std::span<const std::byte> bytes) {
  constexpr std::string_view digits = "0123456789abcdef";
  std::string text;
  text.reserve(2 * bytes.size());
  for (const std::byte b : bytes) {
    text += digits[std::to_integer<unsigned>(b) >> 4];
    text += digits[std::to_integer<unsigned>(b) & 15U];
  }
  return text;
}

std::string to_hex(const Digest& digest) { return hex_of(digest.bytes); }

std::string md5_hex(std::span<const std::byte> bytes) {
  std::array<std::byte, 16> sum{};
  require(EVP_Digest(bytes.data(), bytes.size(), reinterpret_cast<unsigned char*>(sum.data()), nullptr, EVP_md5(),
                     nullptr) == 1);
  return hex_of(sum);
}

Result<Digest> digest_from_hex(std::string_view text) {
  const auto value = [](char c) -> int {
    if (c >= '0' && c <= '9') return c - '0';
    if (c >= 'a' && c <= 'f') return c - 'a' + 10;
    if (c >= 'A' && c <= 'F') return c - 'A' + 10;
    return -1;
  };
  Digest digest;
  if (text.size() != 2 * digest.bytes.size())
    return fail(ErrorCode::InvalidInput, "a SHA-256 digest has 64 hexadecimal digits");
  for (std::size_t i = 0; i < digest.bytes.size(); ++i) {
    const int high = value(text[2 * i]);
    const int low = value(text[2 * i + 1]);
    if (high < 0 || low < 0) return fail(ErrorCode::InvalidInput, "a SHA-256 digest has 64 hexadecimal digits");
    digest.bytes[i] = static_cast<std::byte>(high * 16 + low);
  }
  return digest;
}

}  // namespace telefab
