// SPDX-License-Identifier: GPL-3.0-or-later
#include <openssl/bio.h>
#include <openssl/evp.h>
#include <openssl/pem.h>

#include <array>
#include <charconv>
#include <memory>
#include <span>
#include <telefab/base/file.hpp>
#include <telefab/base/secret.hpp>
#include <telefab/base/signature.hpp>
#include <vector>

namespace telefab {

namespace {

struct FreeOpenSsl {
  void operator()(BIO* p) const { BIO_free(p); }
  void operator()(EVP_PKEY* p) const { EVP_PKEY_free(p); }
  void operator()(EVP_PKEY_CTX* p) const { EVP_PKEY_CTX_free(p); }
  void operator()(EVP_MD_CTX* p) const { EVP_MD_CTX_free(p); }
};
using Bio = std::unique_ptr<BIO, FreeOpenSsl>;
using Key = std::unique_ptr<EVP_PKEY, FreeOpenSsl>;
using Context = std::unique_ptr<EVP_MD_CTX, FreeOpenSsl>;
using Bytes = std::vector<unsigned char>;

std::string hex(std::span<const unsigned char> bytes) {
  static constexpr std::string_view digits = "0123456789abcdef";
  std::string text;
  for (const unsigned char b : bytes) {
    text.push_back(digits[b >> 4]);
    text.push_back(digits[b & 15]);
  }
  return text;
}

/// Empty where the text is not `bytes` pairs of hexadecimal digits.
Bytes from_hex(std::string_view text, std::size_t bytes) {
  if (text.size() != bytes * 2) return {};
  Bytes out(bytes);
  for (std::size_t i = 0; i < bytes; ++i) {
    const char* first = text.data() + 2 * i;
    if (std::from_chars(first, first + 2, out[i], 16).ptr != first + 2) return {};
  }
  return out;
}

Key key_from_pem(std::string_view pem, bool is_private) {
  const Bio bio{BIO_new_mem_buf(pem.data(), static_cast<int>(pem.size()))};
  if (!bio) return {};
  Key key{is_private ? PEM_read_bio_PrivateKey(bio.get(), nullptr, nullptr, nullptr)
                     : PEM_read_bio_PUBKEY(bio.get(), nullptr, nullptr, nullptr)};
  if (key && EVP_PKEY_id(key.get()) != EVP_PKEY_ED25519) return {};
  return key;
}

std::string public_half(const EVP_PKEY* key) {
  std::array<unsigned char, 32> raw{};
  std::size_t size = raw.size();
  if (EVP_PKEY_get_raw_public_key(key, raw.data(), &size) != 1) return {};
  return hex(raw);
}

const unsigned char* bytes_of(std::string_view text) { return reinterpret_cast<const unsigned char*>(text.data()); }

/// Empty where libcrypto cannot.
std::string public_pem_of(EVP_PKEY* key) {
  const Bio open{BIO_new(BIO_s_mem())};
  if (!open || PEM_write_bio_PUBKEY(open.get(), key) != 1) return {};
  char* text = nullptr;
  const long size = BIO_get_mem_data(open.get(), &text);
  return {text, static_cast<std::size_t>(size)};
}

}  // namespace

Result<KeyPair> new_ed25519_key() {
  EVP_PKEY* made = nullptr;
  const std::unique_ptr<EVP_PKEY_CTX, FreeOpenSsl> context{EVP_PKEY_CTX_new_id(EVP_PKEY_ED25519, nullptr)};
  if (!context || EVP_PKEY_keygen_init(context.get()) != 1 || EVP_PKEY_keygen(context.get(), &made) != 1)
    return fail(ErrorCode::Internal, "libcrypto could not make a key");
  const Key key{made};
  const Bio secret{BIO_new(BIO_s_mem())};
  std::string public_pem = public_pem_of(key.get());
  if (!secret || public_pem.empty() ||
      PEM_write_bio_PKCS8PrivateKey(secret.get(), key.get(), nullptr, nullptr, 0, nullptr, nullptr) != 1)
    return fail(ErrorCode::Internal, "libcrypto could not write a key");
  char* text = nullptr;
  const long size = BIO_get_mem_data(secret.get(), &text);
  return KeyPair{std::string{text, static_cast<std::size_t>(size)}, std::move(public_pem)};
}

Result<std::string> kept_ed25519_key(const std::filesystem::path& private_file,
                                     const std::filesystem::path& public_file) {
  auto kept = read_secret(private_file);
  if (!kept && kept.error().code != ErrorCode::NotFound) return kept;
  if (!kept) {
    auto made = new_ed25519_key();
    if (!made) return tl::unexpected{made.error()};
    if (auto written = write_file_atomically(public_file, made->public_pem); !written)
      return tl::unexpected{written.error()};
    if (auto written = write_new_secret(private_file, made->private_pem); !written)
      return tl::unexpected{written.error()};
    return std::move(made->private_pem);
  }
  const Key key = key_from_pem(*kept, true);
  if (!key) return fail(ErrorCode::InvalidInput, private_file.string() + " holds no Ed25519 private key in PEM");
  std::error_code error;
  if (!std::filesystem::exists(public_file, error))
    if (auto written = write_file_atomically(public_file, public_pem_of(key.get())); !written)
      return tl::unexpected{written.error()};
  return kept;
}

Result<Signature> sign_ed25519(std::string_view private_key_pem, std::string_view message) {
  const Key key = key_from_pem(private_key_pem, true);
  if (!key)
    return fail(ErrorCode::InvalidInput,
                "the key is not an Ed25519 private key in PEM; make one with: openssl genpkey -algorithm ed25519");
  const Context context{EVP_MD_CTX_new()};
  std::array<unsigned char, 64> raw{};
  std::size_t size = raw.size();
  if (!context || EVP_DigestSignInit(context.get(), nullptr, nullptr, nullptr, key.get()) != 1 ||
      EVP_DigestSign(context.get(), raw.data(), &size, bytes_of(message), message.size()) != 1)
    return fail(ErrorCode::Internal, "libcrypto could not sign");
  return Signature{hex(raw), public_half(key.get())};
}

Result<void> verify_ed25519(const Signature& signature, std::string_view message, std::string_view public_key_pem) {
  if (!public_key_pem.empty()) {
    const Key expected = key_from_pem(public_key_pem, false);
    if (!expected) return fail(ErrorCode::InvalidInput, "the key to check with is not an Ed25519 public key in PEM");
    if (public_half(expected.get()) != signature.public_key_hex)
      return fail(ErrorCode::NotTrusted, "signed with another key than the one given");
  }
  const Bytes raw = from_hex(signature.signature_hex, 64);
  const Bytes raw_key = from_hex(signature.public_key_hex, 32);
  if (raw.empty() || raw_key.empty()) return fail(ErrorCode::NotTrusted, "the signature is malformed");
  const Key key{EVP_PKEY_new_raw_public_key(EVP_PKEY_ED25519, nullptr, raw_key.data(), raw_key.size())};
  const Context context{EVP_MD_CTX_new()};
  if (!key || !context || EVP_DigestVerifyInit(context.get(), nullptr, nullptr, nullptr, key.get()) != 1 ||
      EVP_DigestVerify(context.get(), raw.data(), raw.size(), bytes_of(message), message.size()) != 1)
    return fail(ErrorCode::NotTrusted, "the signature does not hold");
  return {};
}

}  // namespace telefab
