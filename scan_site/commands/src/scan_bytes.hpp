// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <sys/stat.h>

#include <cstddef>
#include <filesystem>
#include <span>
#include <telefab/base/digest.hpp>
#include <telefab/base/open_file.hpp>
#include <telefab/base/result.hpp>
#include <vector>

namespace telefab::scan {

/// The bytes of a scan file. Those of a large one stay on disk: they are mapped, come when they are looked at and can
/// go again. Move only.
class ScanBytes {
 public:
  /// Fails as read_file does. A large file that becomes shorter while it is looked at ends the program with
  /// ExitCode::Storage and a sentence that names it: nothing can be done with such bytes.
  [[nodiscard]] static Result<ScanBytes> of(const std::filesystem::path& file);
  ~ScanBytes();
  ScanBytes(ScanBytes&& other) noexcept;
  ScanBytes& operator=(ScanBytes&&) = delete;

  [[nodiscard]] std::span<const std::byte> bytes() const { return bytes_; }
  /// What was looked at may leave memory; it comes again where it is looked at again.
  void let_go() const;
  /// Whether all that was looked at were bytes of one file: a mapped one may be written to meanwhile. Fails: Conflict.
  [[nodiscard]] Result<void> is_unchanged() const;
  /// SHA-256 of them, with little of them in memory at once.
  [[nodiscard]] Digest digest() const;

 private:
  ScanBytes() = default;
  std::vector<std::byte> read_;
  std::span<const std::byte> bytes_;
  OpenFile mapped_;  ///< none: they were read
  struct stat when_mapped_ {};
  std::filesystem::path file_;
};

}  // namespace telefab::scan
