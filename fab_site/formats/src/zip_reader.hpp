// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
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
  /// Fails: NotFound, TooLarge (more than 1 GiB, or more than 64 MiB and 200 times the archive), InvalidInput (damaged,
  /// encrypted, larger than it says).
  [[nodiscard]] Result<std::string> entry(const std::string& name);

 private:
  struct Archive;
  explicit ZipReader(std::unique_ptr<Archive> archive);
  std::unique_ptr<Archive> archive_;
};

}  // namespace telefab::fab
