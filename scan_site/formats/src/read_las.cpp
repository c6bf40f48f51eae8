// SPDX-License-Identifier: GPL-3.0-or-later
#include <fmt/format.h>
#include <array>
#include <cmath>

#include "readers.hpp"
#include "scalar_bytes.hpp"
#include "scan_builder.hpp"

namespace telefab::scan {
namespace {

constexpr bool kSwapped = std::endian::native == std::endian::big;
constexpr double kMetreMm = 1000;
/// Least bytes of a record of point format 0, 1, ... 10.
constexpr std::array<std::uint16_t, 11> kRecordBytes{20, 28, 26, 34, 57, 63, 30, 36, 38, 59, 67};
constexpr std::uint8_t kFirstNewFormat = 6;  ///< from here on flags and classes have bytes of their own

/// What the public header block says, LAS 1.0 to 1.4.
struct LasHeader {
  std::uint32_t points_at = 0;
  std::uint8_t format = 0;
  std::uint16_t record_bytes = 0;
  std::uint64_t points = 0;
  Vec3 scale = Vec3::Ones();
  Vec3 offset = Vec3::Zero();
};

Result<LasHeader> read_header(std::span<const std::byte> bytes) {
  const auto bad = [](std::string what) { return fail(ErrorCode::InvalidInput, std::move(what)); };
  constexpr std::size_t kHead12 = 227, kHead14 = 375;
  if (bytes.size() < kHead12) return bad("the file ends within the LAS header: it is truncated");
  const std::byte* const from = bytes.data();
  const int major = static_cast<int>(from[24]), minor = static_cast<int>(from[25]);
  if (major != 1 || minor > 4) return bad(fmt::format("LAS {}.{} is not known; 1.0 to 1.4 are", major, minor));
  const auto head_bytes = load<std::uint16_t>(from + 94, kSwapped);
  LasHeader h;
  h.points_at = load<std::uint32_t>(from + 96, kSwapped);
  const auto format = static_cast<std::uint8_t>(from[104]);
  constexpr std::uint8_t kCompressed = 0xC0;
  if (format & kCompressed)
    return bad(
        "the points are compressed (LAZ), which is not read: write them as LAS first, e.g. with "
        "`laszip -i scan.laz -o scan.las` or `pdal translate scan.laz scan.las`");
  if (format >= kRecordBytes.size()) return bad(fmt::format("LAS point format {} is not known; 0 to 10 are", format));
  h.format = format;
  h.record_bytes = load<std::uint16_t>(from + 105, kSwapped);
  if (h.record_bytes < kRecordBytes[format])
    return bad(
        fmt::format("LAS records of {} bytes; point format {} needs {}", h.record_bytes, format, kRecordBytes[format]));
  h.points = load<std::uint32_t>(from + 107, kSwapped);
  if (minor == 4) {
    if (head_bytes < kHead14 || bytes.size() < kHead14)
      return bad(fmt::format("a LAS 1.4 header has {} bytes, this one {}", kHead14, head_bytes));
    if (const auto points = load<std::uint64_t>(from + 247, kSwapped); points > 0) h.points = points;
  }
  if (head_bytes < kHead12 || h.points_at < head_bytes || h.points_at > bytes.size())
    return bad(fmt::format("the LAS header has {} bytes and puts the points at byte {} of {}", head_bytes, h.points_at,
                           bytes.size()));
  for (int axis = 0; axis < 3; ++axis) {
    h.scale[axis] = load<double>(from + 131 + 8 * axis, kSwapped);
    h.offset[axis] = load<double>(from + 155 + 8 * axis, kSwapped);
  }
  if (!h.scale.allFinite() || !h.offset.allFinite() || (h.scale.array() == 0).any())
    return bad(fmt::format("LAS scale ({}, {}, {}) and offset ({}, {}, {}) must be finite, the scale not 0",
                           h.scale.x(), h.scale.y(), h.scale.z(), h.offset.x(), h.offset.y(), h.offset.z()));
  return h;
}

/// Whether whoever made the file marked the point as deleted.
bool is_withheld(const std::byte* record, std::uint8_t format) {
  const auto flags = static_cast<unsigned>(record[15]);
  return (flags & (format < kFirstNewFormat ? 0x80U : 0x04U)) != 0;
}

}  // namespace

Result<ScanFile> read_las(std::span<const std::byte> bytes, const ReadOptions& options, const std::stop_token& stop) {
  const auto header = read_header(bytes);
  if (!header) return tl::unexpected{header.error()};
  const LasHeader& h = *header;
  const auto body = bytes.subspan(h.points_at);
  ScanBuilder builder{ScanFormat::Las, options};
  builder.state_unit(kMetreMm);
  if (auto room = builder.expect(h.points, body.size(), h.record_bytes); !room) return tl::unexpected{room.error()};
  for (std::uint64_t i = 0; i < h.points; ++i) {
    if (i % kStopEvery == 0 && stop.stop_requested()) return cancelled("reading points");
    const std::byte* const record = body.data() + i * h.record_bytes;
    if (is_withheld(record, h.format)) {
      builder.add_empty_return();
      continue;
    }
    Vec3 p;
    for (int axis = 0; axis < 3; ++axis)
      p[axis] = static_cast<double>(load<std::int32_t>(record + 4 * axis, kSwapped)) * h.scale[axis] + h.offset[axis];
    builder.add(p);
  }
  return std::move(builder).finish();
}

}  // namespace telefab::scan
