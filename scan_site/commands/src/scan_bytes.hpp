// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <cstddef>
#include <filesystem>
#include <span>
#include <telefab/base/digest.hpp>
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
  /// SHA-256 of them, with little of them in memory at once.
  [[nodiscard]] Digest digest() const;

 private:
  ScanBytes() = default;
  std::vector<std::byte> read_;
  std::span<const std::byte> bytes_;
  bool is_mapped_ = false;
};

}  // namespace telefab::scan
