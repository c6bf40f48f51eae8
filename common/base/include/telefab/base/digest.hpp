// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <array>
#include <cstddef>
#include <memory>
#include <span>
#include <string>
#include <telefab/base/result.hpp>

namespace telefab {

/// A SHA-256 value (FIPS 180-4).
struct Digest {
  std::array<std::byte, 32> bytes{};
  friend bool operator==(const Digest&, const Digest&) = default;
};

[[nodiscard]] std::string to_hex(const Digest& digest);
/// Fails with InvalidInput unless the text is 64 hexadecimal digits.
[[nodiscard]] Result<Digest> digest_from_hex(std::string_view text);

/// SHA-256 of what was fed so far. Move only.
class Hasher {
 public:
  Hasher();
  ~Hasher();
  Hasher(Hasher&&) noexcept;
  Hasher& operator=(Hasher&&) noexcept;
  void feed(std::span<const std::byte> bytes);
  void feed(std::string_view text);
  /// The digest of everything fed; feeding may go on afterwards.
  [[nodiscard]] Digest digest() const;

 private:
  struct State;
  std::unique_ptr<State> state_;
};

[[nodiscard]] Digest digest_of(std::span<const std::byte> bytes);

/// MD5 (RFC 1321) in lower-case hexadecimal digits: for protocols that ask for it. It finds damage and proves nothing.
[[nodiscard]] std::string md5_hex(std::span<const std::byte> bytes);

}  // namespace telefab
