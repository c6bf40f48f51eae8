// SPDX-License-Identifier: GPL-3.0-or-later
#include "e57_pages.hpp"

#include <fmt/format.h>
#include <algorithm>

#include "readers.hpp"
#include "scalar_bytes.hpp"
#include "text_cursor.hpp"

namespace telefab::scan {
namespace {

constexpr std::size_t kPage = 1024;
constexpr std::size_t kPayload = kPage - 4;
constexpr std::size_t kHeader = 48;
constexpr bool kBigEndianHost = std::endian::native == std::endian::big;

/// Row k: what a byte does to the CRC of a message when k more bytes follow it.
constexpr auto kCrcTables = [] {
  std::array<std::array<std::uint32_t, 256>, 8> tables{};
  for (std::uint32_t i = 0; i < 256; ++i) {
    std::uint32_t crc = i;
    for (int bit = 0; bit < 8; ++bit) crc = (crc >> 1U) ^ ((crc & 1U) ? 0x82F63B78U : 0U);
    tables[0][i] = crc;
  }
  for (std::size_t k = 1; k < 8; ++k)
    for (std::size_t i = 0; i < 256; ++i) tables[k][i] = (tables[k - 1][i] >> 8U) ^ tables[0][tables[k - 1][i] & 255U];
  return tables;
}();

}  // namespace

std::uint32_t crc32c(std::span<const std::byte> bytes) {
  std::uint32_t crc = ~0U;
  std::size_t at = 0;
  for (; at + 8 <= bytes.size(); at += 8) {
    const std::uint64_t word = load<std::uint64_t>(bytes.data() + at, kBigEndianHost) ^ crc;
    crc = 0;
    for (std::size_t k = 0; k < 8; ++k) crc ^= kCrcTables[7 - k][(word >> (8 * k)) & 255U];
  }
  for (; at < bytes.size(); ++at)
    crc = (crc >> 8U) ^ kCrcTables[0][(crc ^ static_cast<std::uint32_t>(bytes[at])) & 255U];
  return ~crc;
}

Result<E57Bytes> E57Bytes::from(std::span<const std::byte> file, const std::stop_token& stop) {
  if (!as_text(file).starts_with("ASTM-E57"))
    return fail(ErrorCode::InvalidInput, "this is not an E57 file: it does not begin with ASTM-E57");
  if (file.size() < kHeader)
    return fail(ErrorCode::InvalidInput, "the file ends within the E57 header: it is truncated");
  const auto word = [&](std::size_t at) { return load<std::uint64_t>(file.data() + at, kBigEndianHost); };
  const auto major = load<std::uint32_t>(file.data() + 8, kBigEndianHost);
  if (major != 1) return fail(ErrorCode::InvalidInput, fmt::format("E57 version {} is not known; 1 is", major));
  const std::uint64_t length = word(16);
  const std::uint64_t page = word(40);
  if (page != kPage)
    return fail(ErrorCode::InvalidInput, fmt::format("E57 pages of {} bytes; the standard asks for {}", page, kPage));
  if (length > file.size())
    return fail(ErrorCode::InvalidInput,
                fmt::format("the E57 header says {} bytes but the file has {}: it is truncated", length, file.size()));
  if (length == 0 || length % kPage != 0)
    return fail(ErrorCode::InvalidInput, fmt::format("{} bytes are no whole number of E57 pages", length));

  E57Bytes bytes;
  bytes.xml_offset_ = word(24);
  bytes.xml_length_ = word(32);
  const std::size_t pages = length / kPage;
  bytes.logical_.resize(pages * kPayload);
  for (std::size_t i = 0; i < pages; ++i) {
    if (i % (kStopEvery / kPage) == 0 && stop.stop_requested()) return cancelled("reading pages");
    const auto payload = file.subspan(i * kPage, kPayload);
    const auto stated = load<std::uint32_t>(payload.data() + kPayload, !kBigEndianHost);
    if (const std::uint32_t found = crc32c(payload); found != stated)
      return fail(ErrorCode::InvalidInput,
                  fmt::format("E57 page {} of {} (byte {}) is damaged: its checksum is {:08x}, its content has {:08x}; "
                              "copy the file again or export it again",
                              i, pages, i * kPage, stated, found));
    std::copy(payload.begin(), payload.end(), bytes.logical_.begin() + static_cast<std::ptrdiff_t>(i * kPayload));
  }
  return bytes;
}

Result<std::span<const std::byte>> E57Bytes::at(std::uint64_t physical_offset, std::uint64_t length) const {
  const std::uint64_t page = physical_offset / kPage;
  const std::uint64_t within = physical_offset % kPage;
  const std::uint64_t start = page * kPayload + within;
  if (within >= kPayload || page >= logical_.size() / kPayload || length > logical_.size() - start)
    return fail(ErrorCode::InvalidInput,
                fmt::format("{} bytes from byte {} on are named but lie beyond the file's end or on a checksum", length,
                            physical_offset));
  return std::span{logical_}.subspan(start, length);
}

}  // namespace telefab::scan
