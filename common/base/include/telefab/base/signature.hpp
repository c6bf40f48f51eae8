// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <filesystem>
#include <string>
#include <string_view>
#include <telefab/base/result.hpp>

namespace telefab {

/// An Ed25519 signature (RFC 8032) with the key that made it, both in hexadecimal.
struct Signature {
  std::string signature_hex;   ///< 128 digits
  std::string public_key_hex;  ///< 64 digits
};

struct KeyPair {
  std::string private_pem;
  std::string public_pem;
};

/// A new Ed25519 key from the system's random numbers, both halves in PEM.
[[nodiscard]] Result<KeyPair> new_ed25519_key();

/// The private key of a file, in PEM; made where there is none, the public half first, so that a writer that was killed
/// between them makes both again. A public half that was lost is written again. Fails as read_secret, write_new_secret
/// and write_file_atomically, and with InvalidInput where the file holds no Ed25519 key.
[[nodiscard]] Result<std::string> kept_ed25519_key(const std::filesystem::path& private_file,
                                                   const std::filesystem::path& public_file);

/// Signs with a private key in PEM, as `openssl genpkey -algorithm ed25519` writes it. InvalidInput for any other key.
[[nodiscard]] Result<Signature> sign_ed25519(std::string_view private_key_pem, std::string_view message);

/// NotTrusted unless the signature holds; where `public_key_pem` is not empty it must also be that key's.
[[nodiscard]] Result<void> verify_ed25519(const Signature& signature, std::string_view message,
                                          std::string_view public_key_pem);

}  // namespace telefab
