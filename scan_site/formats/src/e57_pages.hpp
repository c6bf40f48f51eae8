// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <array>
#include <cstddef>
#include <cstdint>
#include <span>
#include <stop_token>
#include <telefab/base/result.hpp>
#include <vector>

// ASTM E2807: an E57 file is pages of 1024 bytes, the last four of each a CRC-32C, big-endian, of the others. Offsets
// in the file count all bytes ("physical"); what is stored runs on over the page ends ("logical").
namespace telefab::scan {

/// The Castagnoli CRC (polynomial 0x1EDC6F41, reflected) of `bytes`.
[[nodiscard]] std::uint32_t crc32c(std::span<const std::byte> bytes);

/// The file without its checksums, all of which were right.
class E57Bytes {
 public:
  /// Fails: InvalidInput (no E57 file, not version 1, truncated, a page whose checksum is wrong: says which),
  /// Cancelled.
  [[nodiscard]] static Result<E57Bytes> from(std::span<const std::byte> file, const std::stop_token& stop);

  [[nodiscard]] std::size_t size() const { return logical_.size(); }
  /// `length` logical bytes from a physical offset; InvalidInput if the file does not hold them.
  [[nodiscard]] Result<std::span<const std::byte>> at(std::uint64_t physical_offset, std::uint64_t length) const;
  [[nodiscard]] Result<std::span<const std::byte>> xml() const { return at(xml_offset_, xml_length_); }

 private:
  std::vector<std::byte> logical_;
  std::uint64_t xml_offset_ = 0;  ///< physical
  std::uint64_t xml_length_ = 0;  ///< logical
};

}  // namespace telefab::scan
