// SPDX-License-Identifier: GPL-3.0-or-later
#include <fmt/format.h>
#include <algorithm>
#include <cctype>
#include <cmath>
#include <string>

#include "lzf.hpp"
#include "readers.hpp"
#include "scalar_bytes.hpp"
#include "scan_builder.hpp"
#include "text_cursor.hpp"

namespace telefab::scan {
namespace {

char upper(char c) { return static_cast<char>(std::toupper(static_cast<unsigned char>(c))); }
bool same_letter(char a, char b) { return upper(a) == upper(b); }

std::string in_capitals(std::string_view word) {
  std::string text{word};
  std::transform(text.begin(), text.end(), text.begin(), upper);
  return text;
}

struct PcdField {
  std::string name;
  std::size_t size = 4;
  char kind = 'F';
  std::uint64_t count = 1;
  ScalarType type = ScalarType::Float32;
  std::size_t offset = 0;        ///< in a binary record
  std::size_t first_column = 0;  ///< among the numbers of a text line
};

struct PcdHeader {
  std::vector<PcdField> fields;
  std::uint64_t width = 0;
  std::uint64_t height = 1;
  std::uint64_t points = 0;
  std::optional<Vec3> viewpoint;
  std::string encoding;
  std::size_t record_bytes = 0;
  std::size_t record_columns = 0;
  std::size_t body_offset = 0;

  [[nodiscard]] const PcdField* field(std::string_view name) const {
    for (const PcdField& f : fields)
      if (f.count > 0 && std::equal(f.name.begin(), f.name.end(), name.begin(), name.end(), same_letter)) return &f;
    return nullptr;
  }
};

std::optional<ScalarType> type_of(char kind, std::size_t size) {
  if (kind == 'F')
    return size == 4   ? std::optional{ScalarType::Float32}
           : size == 8 ? std::optional{ScalarType::Float64}
                       : std::nullopt;
  if (kind != 'I' && kind != 'U') return std::nullopt;
  const bool is_signed = kind == 'I';
  switch (size) {
    case 1:
      return is_signed ? ScalarType::Int8 : ScalarType::Uint8;
    case 2:
      return is_signed ? ScalarType::Int16 : ScalarType::Uint16;
    case 4:
      return is_signed ? ScalarType::Int32 : ScalarType::Uint32;
    case 8:
      return is_signed ? ScalarType::Int64 : ScalarType::Uint64;
    default:
      return std::nullopt;
  }
}

/// Types, offsets and totals once all lines are read.
Result<void> complete(PcdHeader& header) {
  constexpr std::uint64_t kMaxRecord = 1U << 16;
  for (PcdField& f : header.fields) {
    const auto type = type_of(f.kind, f.size);
    if (!type || f.count > kMaxRecord)
      return fail(ErrorCode::InvalidInput, fmt::format("PCD field {}: type {} of size {} and count {} is not known",
                                                       f.name.substr(0, 40), f.kind, f.size, f.count));
    f.type = *type;
    f.offset = header.record_bytes;
    f.first_column = header.record_columns;
    header.record_bytes += f.size * f.count;
    header.record_columns += f.count;
    if (header.record_bytes > kMaxRecord) return fail(ErrorCode::InvalidInput, "PCD records above 64 KiB");
  }
  if (!header.field("x") || !header.field("y") || !header.field("z"))
    return fail(ErrorCode::InvalidInput, "PCD without the fields x, y and z");
  if (header.width > UINT32_MAX || header.height > UINT32_MAX || header.width * header.height != header.points)
    return fail(ErrorCode::InvalidInput, fmt::format("PCD header: WIDTH {} x HEIGHT {} is not POINTS {}", header.width,
                                                     header.height, header.points));
  return {};
}

Result<PcdHeader> read_header(std::string_view text) {
  TextCursor lines{text};
  PcdHeader header;
  bool has_points = false;
  while (!lines.at_end()) {
    FieldCursor words{lines.take_line()};
    const std::string key = in_capitals(words.take_word());
    const auto bad = [&](std::string_view why) {
      return fail(ErrorCode::InvalidInput, fmt::format("PCD header, line {}: {}", lines.line_number(), why));
    };
    if (key == "FIELDS" || key == "COLUMNS") {
      while (!words.at_end()) header.fields.push_back({.name = std::string{words.take_word()}});
    } else if (key == "SIZE" || key == "COUNT" || key == "TYPE") {
      for (PcdField& f : header.fields) {
        if (key == "TYPE") {
          const std::string_view word = words.take_word();
          if (word.size() != 1) return bad("TYPE must have one letter a field");
          f.kind = upper(word[0]);
          continue;
        }
        const auto number = words.take<std::uint64_t>();
        if (!number) return bad("one number a field is needed");
        (key == "SIZE" ? f.size : f.count) = *number;
      }
    } else if (key == "WIDTH" || key == "HEIGHT" || key == "POINTS") {
      const auto number = words.take<std::uint64_t>();
      if (!number) return bad("a count of 0 or more is needed");
      if (key == "WIDTH") header.width = *number;
      if (key == "HEIGHT") header.height = *number;
      if (key == "POINTS") header.points = *number, has_points = true;
    } else if (key == "VIEWPOINT") {
      Vec3 at;
      for (int axis = 0; axis < 3; ++axis) at[axis] = words.take<double>().value_or(0);
      if (at.allFinite()) header.viewpoint = at;
    } else if (key == "DATA") {
      header.encoding = words.take_word();
      std::transform(header.encoding.begin(), header.encoding.end(), header.encoding.begin(),
                     [](unsigned char c) { return static_cast<char>(std::tolower(c)); });
      header.body_offset = text.size() - lines.bytes_left();
      if (!has_points) header.points = header.width * header.height;
      if (auto done = complete(header); !done) return tl::unexpected{done.error()};
      return header;
    } else if (!key.empty() && key[0] != '#' && key != "VERSION") {
      return bad(fmt::format("unknown keyword '{}'", key.substr(0, 40)));
    }
  }
  return fail(ErrorCode::InvalidInput, "PCD header without a DATA line: the file is truncated or not a PCD file");
}

/// Takes the numbers of record after record, whatever the encoding, and puts them where they belong.
class RecordTaker {
 public:
  RecordTaker(const PcdHeader& header, ScanBuilder& builder) : builder_{builder}, organised_{header.height > 1} {
    if (!organised_) return;
    view_.rows = static_cast<std::uint32_t>(header.height);
    view_.columns = static_cast<std::uint32_t>(header.width);
    view_.scanner = header.viewpoint;
    view_.point_at.reserve(header.points);
  }
  void take(const Vec3& position, const Vec3& normal) {
    if (organised_) view_.point_at.push_back(static_cast<std::int32_t>(builder_.size()));
    builder_.add(position);
    builder_.add_normal(normal);
  }
  void finish(bool has_normals) {
    if (organised_) {
      builder_.add_view(std::move(view_));
      builder_.zeros_are_no_return();
    }
    if (!has_normals) builder_.forget_normals();
  }

 private:
  ScanBuilder& builder_;
  bool organised_;
  RangeView view_;
};

struct Columns {
  std::array<const PcdField*, 3> position{};
  std::array<const PcdField*, 3> normal{};
  [[nodiscard]] bool has_normals() const { return normal[0] && normal[1] && normal[2]; }
};

/// `value(field, record)` gives one number of one record.
template <class Value>
Result<void> take_records(const PcdHeader& header, const Columns& columns, RecordTaker& taker,
                          const std::stop_token& stop, Value value) {
  for (std::uint64_t i = 0; i < header.points; ++i) {
    if (i % kStopEvery == 0 && stop.stop_requested()) return cancelled("reading points");
    Vec3 position, normal = Vec3::Zero();
    for (std::size_t axis = 0; axis < 3; ++axis) {
      position[static_cast<int>(axis)] = value(*columns.position[axis], i);
      if (columns.has_normals()) normal[static_cast<int>(axis)] = value(*columns.normal[axis], i);
    }
    taker.take(position, normal);
  }
  return {};
}

/// One record a line.
Result<void> take_text(std::string_view body, const PcdHeader& header, const Columns& columns, RecordTaker& taker,
                       ScanBuilder& builder, const std::stop_token& stop) {
  TextCursor lines{body};
  std::vector<double> record(header.record_columns);
  bool decimal_comma = false;
  for (std::uint64_t i = 0; i < header.points; ++i) {
    if (i % kStopEvery == 0 && stop.stop_requested()) return cancelled("reading points");
    const std::string_view line = lines.take_full_line();
    if (line.empty())
      return fail(ErrorCode::InvalidInput,
                  fmt::format("the file ends within point {} of {}: it is truncated", i, header.points));
    FieldCursor fields{line, CommaRule::Decimal};
    for (double& number : record) {
      const auto value = fields.take<double>();
      if (!value && fields.at_end())
        return fail(
            ErrorCode::InvalidInput,
            fmt::format("point {}: the line '{}' has less than the {} values of a point{}{}", i, line.substr(0, 60),
                        record.size(), lines.at_end() ? "; the file is truncated" : "", about_commas(line)));
      if (!value)
        return fail(ErrorCode::InvalidInput,
                    fmt::format("point {}: '{}' is not a number", i, fields.take_word().substr(0, 40)));
      number = *value;
    }
    if (!fields.at_end())
      return fail(ErrorCode::InvalidInput,
                  fmt::format("point {}: the line '{}' has more than the {} values of a point{}", i, line.substr(0, 60),
                              record.size(), about_commas(line)));
    if (fields.saw_decimal_comma() && !decimal_comma) {
      decimal_comma = true;
      builder.note(ScanRemark::DecimalComma,
                   fmt::format("numbers have a decimal comma: the first line that has is {}", line.substr(0, 60)));
    }
    Vec3 position, normal = Vec3::Zero();
    for (std::size_t axis = 0; axis < 3; ++axis) {
      position[static_cast<int>(axis)] = record[columns.position[axis]->first_column];
      if (columns.has_normals()) normal[static_cast<int>(axis)] = record[columns.normal[axis]->first_column];
    }
    taker.take(position, normal);
  }
  return {};
}

/// binary_compressed: two sizes, then LZF of the records stored field by field.
Result<std::vector<std::byte>> unpack(std::span<const std::byte> body, const PcdHeader& header) {
  if (body.size() < 8)
    return fail(ErrorCode::InvalidInput, "the file ends before the compressed points: it is truncated");
  const bool swapped = std::endian::native == std::endian::big;
  const auto packed_size = load<std::uint32_t>(body.data(), swapped);
  const auto size = load<std::uint32_t>(body.data() + 4, swapped);
  if (packed_size > body.size() - 8)
    return fail(ErrorCode::InvalidInput,
                fmt::format("{} compressed bytes are claimed but only {} follow: the file is truncated", packed_size,
                            body.size() - 8));
  if (size / header.record_bytes < header.points)
    return fail(ErrorCode::InvalidInput,
                fmt::format("{} bytes cannot hold the {} points claimed", size, header.points));
  auto raw = expand_lzf(body.subspan(8, packed_size), size);
  if (!raw) return fail(ErrorCode::InvalidInput, "the compressed points are damaged");
  return std::move(*raw);
}

}  // namespace

Result<ScanFile> read_pcd(std::span<const std::byte> bytes, const ReadOptions& options, const std::stop_token& stop) {
  const auto header = read_header(as_text(bytes));
  if (!header) return tl::unexpected{header.error()};
  const PcdHeader& h = *header;
  const Columns columns{{h.field("x"), h.field("y"), h.field("z")},
                        {h.field("normal_x"), h.field("normal_y"), h.field("normal_z")}};
  std::span<const std::byte> body = bytes.subspan(h.body_offset);
  std::vector<std::byte> raw;
  if (h.encoding == "binary_compressed") {
    auto unpacked = unpack(body, h);
    if (!unpacked) return tl::unexpected{unpacked.error()};
    raw = std::move(*unpacked);
    body = raw;
  } else if (h.encoding != "ascii" && h.encoding != "binary") {
    return fail(ErrorCode::InvalidInput, fmt::format("PCD DATA '{}' is not known", h.encoding.substr(0, 40)));
  }

  ScanBuilder builder{ScanFormat::Pcd, options};
  const std::uint64_t each = h.encoding == "ascii" ? 2 * h.record_columns - 1 : h.record_bytes;
  if (auto room = builder.expect(h.points, body.size() + (h.encoding == "ascii" ? 1 : 0), each); !room)
    return tl::unexpected{room.error()};
  RecordTaker taker{h, builder};
  const bool swapped = std::endian::native == std::endian::big;
  Result<void> done;
  if (h.encoding == "ascii")
    done = take_text(as_text(body), h, columns, taker, builder, stop);
  else if (h.encoding == "binary")
    done = take_records(h, columns, taker, stop, [&](const PcdField& f, std::uint64_t i) {
      return load_as_double(body.data() + i * h.record_bytes + f.offset, f.type, swapped);
    });
  else
    done = take_records(h, columns, taker, stop, [&](const PcdField& f, std::uint64_t i) {
      return load_as_double(body.data() + f.offset * h.points + i * f.size * f.count, f.type, swapped);
    });
  if (!done) return tl::unexpected{done.error()};
  taker.finish(columns.has_normals());
  return std::move(builder).finish();
}

}  // namespace telefab::scan
