// SPDX-License-Identifier: GPL-3.0-or-later
#include <fmt/format.h>
#include <algorithm>
#include <array>
#include <cmath>
#include <cstring>

#include "e57_pages.hpp"
#include "e57_scans.hpp"
#include "readers.hpp"
#include "scalar_bytes.hpp"
#include "scan_builder.hpp"

namespace telefab::scan {
namespace {

constexpr bool kSwapped = std::endian::native == std::endian::big;
constexpr double kMetreMm = 1000;

/// The fields of a scan that a cloud has use for, as places in its prototype.
struct Wanted {
  std::array<std::optional<std::size_t>, 3> position, normal;
  std::optional<std::size_t> invalid, row, column;
  bool spherical = false;  ///< position is range, azimuth, elevation

  [[nodiscard]] bool has_normals() const { return normal[0] && normal[1] && normal[2]; }
  [[nodiscard]] bool has_grid() const { return row && column; }
  [[nodiscard]] bool has(std::size_t field) const {
    const auto any = [&](const auto& list) { return std::find(list.begin(), list.end(), field) != list.end(); };
    return any(position) || (has_normals() && any(normal)) || invalid == field ||
           (has_grid() && (row == field || column == field));
  }
};

Result<Wanted> wanted_of(const E57Scan& scan) {
  Wanted w;
  w.position = {scan.field("cartesianX"), scan.field("cartesianY"), scan.field("cartesianZ")};
  w.spherical = !w.position[0] || !w.position[1] || !w.position[2];
  if (w.spherical)
    w.position = {scan.field("sphericalRange"), scan.field("sphericalAzimuth"), scan.field("sphericalElevation")};
  w.invalid = scan.field(w.spherical ? "sphericalInvalidState" : "cartesianInvalidState");
  w.normal = {scan.field("normalX"), scan.field("normalY"), scan.field("normalZ")};
  w.row = scan.field("rowIndex");
  w.column = scan.field("columnIndex");
  unsigned bits = 0;
  for (const auto& place : w.position) {
    if (!place) return fail(ErrorCode::InvalidInput, "E57: points without cartesian or spherical coordinates");
    bits += scan.fields[*place].bits;
  }
  for (std::size_t i = 0; i < scan.fields.size(); ++i)
    if (w.has(i) && scan.fields[i].kind == E57Field::Kind::Text)
      return fail(ErrorCode::InvalidInput, fmt::format("E57: field {} is text", scan.fields[i].name));
  constexpr unsigned kLeastBits = 8;  // fewer could claim many points in few bytes
  if (bits < kLeastBits)
    return fail(ErrorCode::InvalidInput, fmt::format("E57: {} bits for a position hold no scan", bits));
  return w;
}

/// The byte streams of the fields wanted, each in one piece; the others stay empty. A stream runs on from packet to
/// packet without regard to the ends of values.
Result<std::vector<std::vector<std::byte>>> streams_of(std::span<const std::byte> packets, const E57Scan& scan,
                                                       const Wanted& wanted, const std::stop_token& stop) {
  enum class Packet : std::uint8_t { Index = 0, Data = 1, Ignored = 2 };
  constexpr std::size_t kDataHead = 6;
  std::vector<std::vector<std::byte>> streams(scan.fields.size());
  const auto bad = [](std::string_view why) {
    return fail(ErrorCode::InvalidInput, fmt::format("E57: a data packet is damaged: {}", why));
  };
  for (std::size_t at = 0; at + 4 <= packets.size();) {
    if (stop.stop_requested()) return cancelled("reading points");
    const auto kind = static_cast<Packet>(packets[at]);
    const std::size_t length = std::size_t{load<std::uint16_t>(packets.data() + at + 2, kSwapped)} + 1;
    if (kind > Packet::Ignored)
      return bad(fmt::format("packets of kind {} are not known", static_cast<int>(packets[at])));
    if (length % 4 != 0 || length > packets.size() - at) return bad("its length does not fit its section");
    const auto packet = packets.subspan(at, length);
    at += length;
    if (kind != Packet::Data) continue;
    if (length < kDataHead + 2) return bad("it is shorter than its head");
    const std::size_t count = load<std::uint16_t>(packet.data() + 4, kSwapped);
    if (count != scan.fields.size())
      return bad(fmt::format("{} byte streams for {} fields", count, scan.fields.size()));
    std::size_t from = kDataHead + 2 * count;
    for (std::size_t i = 0; i < count; ++i) {
      if (from > length) return bad("its head is longer than itself");
      const std::size_t bytes = load<std::uint16_t>(packet.data() + kDataHead + 2 * i, kSwapped);
      if (bytes > length - from) return bad("its byte streams are longer than itself");
      const auto stream = packet.subspan(from, bytes);
      if (wanted.has(i)) streams[i].insert(streams[i].end(), stream.begin(), stream.end());
      from += bytes;
    }
  }
  return streams;
}

/// Takes value after value out of one stream. The stream has `kPad` bytes more than its values.
class ValueReader {
 public:
  static constexpr std::size_t kPad = 9;
  ValueReader(const E57Field& field, std::span<const std::byte> stream) : field_{field}, at_{stream.data()} {}

  [[nodiscard]] double value(std::uint64_t index) const {
    switch (field_.kind) {
      case E57Field::Kind::Float32:
        return static_cast<double>(load<float>(at_ + 4 * index, kSwapped));
      case E57Field::Kind::Float64:
        return load<double>(at_ + 8 * index, kSwapped);
      case E57Field::Kind::Integer:
      case E57Field::Kind::Text:
        break;
    }
    // beyond the stated maximum is damage, which NaN carries to the check of the builder
    const std::uint64_t raw = bits_at(index);
    if (raw > field_.span) return std::nan("");
    const auto integer = static_cast<std::int64_t>(static_cast<std::uint64_t>(field_.least) + raw);
    return static_cast<double>(integer) * field_.scale + field_.offset;
  }

 private:
  [[nodiscard]] std::uint64_t bits_at(std::uint64_t index) const {
    if (field_.bits == 0) return 0;
    const std::uint64_t bit = index * field_.bits;
    const auto shift = static_cast<unsigned>(bit % 8);
    const std::byte* from = at_ + bit / 8;
    std::uint64_t raw = load<std::uint64_t>(from, kSwapped) >> shift;
    if (shift + field_.bits > 64) raw |= static_cast<std::uint64_t>(from[8]) << (64 - shift);
    return field_.bits == 64 ? raw : raw & ((std::uint64_t{1} << field_.bits) - 1);
  }

  const E57Field& field_;
  const std::byte* at_;
};

Vec3 cartesian_of(const Vec3& range_azimuth_elevation) {
  const double flat = range_azimuth_elevation[0] * std::cos(range_azimuth_elevation[2]);
  return {flat * std::cos(range_azimuth_elevation[1]), flat * std::sin(range_azimuth_elevation[1]),
          range_azimuth_elevation[0] * std::sin(range_azimuth_elevation[2])};
}

/// Which cell of the scanner's grid saw which point; none where the grid is far larger than what was seen.
class GridTaker {
 public:
  void take(double row, double column, std::size_t point) {
    constexpr double kMaxSide = 1e6;
    if (!(row >= 0 && row < kMaxSide && column >= 0 && column < kMaxSide) || point > INT32_MAX) {
      whole_ = false;
      return;
    }
    cells_.push_back(
        {static_cast<std::uint32_t>(row), static_cast<std::uint32_t>(column), static_cast<std::int32_t>(point)});
    rows_ = std::max(rows_, cells_.back().row + 1);
    columns_ = std::max(columns_, cells_.back().column + 1);
  }
  [[nodiscard]] std::optional<RangeView> view(std::optional<Vec3> scanner) const {
    constexpr std::uint64_t kMostCellsAPoint = 64;
    const std::uint64_t size = std::uint64_t{rows_} * columns_;
    if (!whole_ || cells_.empty() || rows_ < 2 || columns_ < 2 || size > kMostCellsAPoint * cells_.size())
      return std::nullopt;
    RangeView view{rows_, columns_, std::vector<std::int32_t>(size, RangeView::kEmpty), scanner};
    for (const Cell& c : cells_) view.point_at[std::size_t{c.row} * columns_ + c.column] = c.point;
    return view;
  }

 private:
  struct Cell {
    std::uint32_t row, column;
    std::int32_t point;
  };
  std::vector<Cell> cells_;
  std::uint32_t rows_ = 0, columns_ = 0;
  bool whole_ = true;
};

Result<void> take_points(const E57Scan& scan, const Wanted& wanted, const std::vector<std::vector<std::byte>>& streams,
                         ScanBuilder& builder, const std::stop_token& stop) {
  const auto reader = [&](std::optional<std::size_t> field) -> std::optional<ValueReader> {
    if (!field) return std::nullopt;
    return ValueReader{scan.fields[*field], streams[*field]};
  };
  const std::array position{*reader(wanted.position[0]), *reader(wanted.position[1]), *reader(wanted.position[2])};
  std::vector<ValueReader> normal;
  for (const auto& place : wanted.normal)
    if (wanted.has_normals()) normal.push_back(*reader(place));
  const auto invalid = reader(wanted.invalid);
  const auto row = reader(wanted.row), column = reader(wanted.column);
  GridTaker grid;
  for (std::uint64_t i = 0; i < scan.records; ++i) {
    if (i % kStopEvery == 0 && stop.stop_requested()) return cancelled("reading points");
    if (invalid && invalid->value(i) != 0) {
      builder.add_empty_return();
      continue;
    }
    Vec3 p{position[0].value(i), position[1].value(i), position[2].value(i)};
    if (row && column && (wanted.spherical ? p.x() == 0 : p.isZero(0))) {  // a cell of the grid that saw nothing
      builder.add_empty_return();
      continue;
    }
    if (wanted.spherical) p = cartesian_of(p);
    if (scan.pose) p = *scan.pose * p;
    if (row && column) grid.take(row->value(i), column->value(i), builder.size());
    builder.add(p);
    Vec3 n = Vec3::Zero();
    if (!normal.empty()) n = {normal[0].value(i), normal[1].value(i), normal[2].value(i)};
    builder.add_normal(scan.pose ? Vec3{scan.pose->linear() * n} : n);
  }
  const auto scanner = scan.pose ? std::optional<Vec3>{scan.pose->translation()} : std::nullopt;
  if (auto view = grid.view(scanner)) builder.add_view(std::move(*view));
  return {};
}

/// Head of a compressed vector section.
struct Section {
  std::span<const std::byte> packets;
  std::uint64_t length = 0;  ///< logical, head and packets
};

Result<Section> section_of(const E57Bytes& file, const E57Scan& scan) {
  constexpr std::uint64_t kHead = 32;
  const auto head = file.at(scan.offset, kHead);
  if (!head) return fail_in("E57 points", head.error());
  const auto word = [&](std::size_t at) { return load<std::uint64_t>(head->data() + at, kSwapped); };
  const std::uint64_t length = word(8);
  if (static_cast<int>((*head)[0]) != 1 || length < kHead)
    return fail(ErrorCode::InvalidInput,
                fmt::format("E57: byte {} begins no section of compressed points", scan.offset));
  const auto whole = file.at(scan.offset, length);
  if (!whole) return fail_in("E57 points", whole.error());
  const auto data = file.at(word(16), 0);
  if (!data) return fail_in("E57 points", data.error());
  const std::byte* const begin = whole->data() + kHead;
  const std::byte* const end = whole->data() + length;
  if (data->data() < begin || data->data() > end)
    return fail(ErrorCode::InvalidInput,
                fmt::format("E57: the packets at byte {} lie outside their section", word(16)));
  return Section{{data->data(), end}, length};
}

Result<void> read_one(const E57Bytes& file, const E57Scan& scan, std::uint64_t& room, ScanBuilder& builder,
                      const std::stop_token& stop) {
  const auto wanted = wanted_of(scan);
  if (!wanted) return tl::unexpected{wanted.error()};
  const auto section = section_of(file, scan);
  if (!section) return tl::unexpected{section.error()};
  // sections that overlap would let a small file claim a great many points
  if (section->length > room) return fail(ErrorCode::InvalidInput, "E57: the sections are longer than the file");
  room -= section->length;
  auto streams = streams_of(section->packets, scan, *wanted, stop);
  if (!streams) return tl::unexpected{streams.error()};
  if (auto ok = builder.expect(scan.records, section->length, 1); !ok) return ok;
  for (std::size_t i = 0; i < scan.fields.size(); ++i) {
    if (!wanted->has(i)) continue;
    std::vector<std::byte>& stream = (*streams)[i];
    const unsigned bits = scan.fields[i].bits;
    if (bits > 0 && scan.records > 8 * stream.size() / bits)
      return fail(ErrorCode::InvalidInput, fmt::format("E57: {} points are claimed but field {} has only {} values",
                                                       scan.records, scan.fields[i].name, 8 * stream.size() / bits));
    stream.resize(stream.size() + ValueReader::kPad);
  }
  return take_points(scan, *wanted, *streams, builder, stop);
}

}  // namespace

Result<ScanFile> read_e57(std::span<const std::byte> bytes, const ReadOptions& options, const std::stop_token& stop) {
  const auto file = E57Bytes::from(bytes, stop);
  if (!file) return tl::unexpected{file.error()};
  const auto xml = file->xml();
  if (!xml) return fail_in("E57 XML section", xml.error());
  const auto scans = e57_scans_of(*xml);
  if (!scans) return tl::unexpected{scans.error()};
  ScanBuilder builder{ScanFormat::E57, options};
  builder.state_unit(kMetreMm);
  std::uint64_t room = file->size();
  bool all_have_normals = true;
  for (std::size_t i = 0; i < scans->size(); ++i) {
    const E57Scan& scan = (*scans)[i];
    if (scan.records == 0) continue;
    if (auto done = read_one(*file, scan, room, builder, stop); !done)
      return fail_in(fmt::format("scan {}", i), done.error());
    all_have_normals = all_have_normals && scan.field("normalX") && scan.field("normalY") && scan.field("normalZ");
  }
  if (!all_have_normals) builder.forget_normals();
  return std::move(builder).finish();
}

}  // namespace telefab::scan
