// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <cstdint>
#include <memory>
#include <span>
#include <string>
#include <telefab/base/result.hpp>
#include <vector>

namespace telefab::fab {

/// An archive in memory. What an entry unpacks to is bounded before memory is taken.
class ZipReader {
 public:
  /// `bytes` must outlive the reader. Fails with InvalidInput.
  [[nodiscard]] static Result<ZipReader> open(std::span<const std::byte> bytes);
  ~ZipReader();
  ZipReader(ZipReader&&) noexcept;
  ZipReader& operator=(ZipReader&&) noexcept;

  [[nodiscard]] bool has(const std::string& name) const;
  /// Of all entries, in the order of the archive.
  [[nodiscard]] std::vector<std::string> names() const;
  /// Fails: NotFound, TooLarge (more than `most` or 1 GiB, or more than 64 MiB and 200 times the archive), InvalidInput
  /// (damaged, encrypted, larger than it says). Texts that are parsed whole have a `most` of kMostText.
  [[nodiscard]] Result<std::string> entry(const std::string& name, std::uint64_t most = ~std::uint64_t{0});
  static constexpr std::uint64_t kMostText = 8U << 20U;  ///< bytes

 private:
  struct Archive;
  explicit ZipReader(std::unique_ptr<Archive> archive);
  std::unique_ptr<Archive> archive_;
};

}  // namespace telefab::fab
