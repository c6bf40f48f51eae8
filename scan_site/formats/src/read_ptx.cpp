// SPDX-License-Identifier: GPL-3.0-or-later
#include <fmt/format.h>
#include <Eigen/Core>

#include "readers.hpp"
#include "scan_builder.hpp"
#include "text_cursor.hpp"

namespace telefab::scan {
namespace {

/// Numbers of one line, or nothing if there are not exactly `N`.
template <int N>
std::optional<Eigen::Matrix<double, N, 1>> numbers(std::string_view line) {
  FieldCursor fields{line, CommaRule::Decimal};
  Eigen::Matrix<double, N, 1> out;
  for (int i = 0; i < N; ++i) {
    const auto value = fields.take<double>();
    if (!value) return std::nullopt;
    out[i] = *value;
  }
  if (!fields.at_end()) return std::nullopt;
  return out;
}

std::optional<std::uint32_t> whole_number(std::string_view line) {
  FieldCursor fields{line};
  const auto value = fields.take<std::uint32_t>();
  return fields.at_end() ? value : std::nullopt;
}

struct PtxHeader {
  std::uint32_t columns = 0;
  std::uint32_t rows = 0;
  Eigen::Matrix4d pose = Eigen::Matrix4d::Identity();  ///< p' = [p 1] * pose: rows are the images of the axes
};

/// The ten header lines of one scan. Nothing if they are not what PTX asks for.
std::optional<PtxHeader> read_header(TextCursor& lines) {
  PtxHeader header;
  const auto columns = whole_number(lines.take_full_line());
  const auto rows = whole_number(lines.take_full_line());
  if (!columns || !rows) return std::nullopt;
  header.columns = *columns;
  header.rows = *rows;
  for (int i = 0; i < 4; ++i)  // scanner position and axes: the matrix below says the same and is what counts
    if (!numbers<3>(lines.take_full_line())) return std::nullopt;
  for (int i = 0; i < 4; ++i) {
    const auto row = numbers<4>(lines.take_full_line());
    if (!row) return std::nullopt;
    header.pose.row(i) = row->transpose();
  }
  return header;
}

/// The points of one scan, column by column, into the builder and a view.
Result<void> read_view(TextCursor& lines, const PtxHeader& header, ScanBuilder& builder, const std::stop_token& stop) {
  RangeView view{header.rows, header.columns, {}, Vec3{header.pose.row(3).head<3>()}};
  const std::uint64_t cells = std::uint64_t{header.rows} * header.columns;
  if (auto room = builder.expect(cells, lines.bytes_left() + 1, 8); !room) return room;
  view.point_at.assign(cells, RangeView::kEmpty);
  bool decimal_comma = false;
  for (std::uint32_t column = 0; column < header.columns; ++column) {
    if (stop.stop_requested()) return cancelled("reading points");
    for (std::uint32_t row = 0; row < header.rows; ++row) {
      const std::string_view line = lines.take_full_line();
      if (line.empty())
        return fail(ErrorCode::InvalidInput,
                    fmt::format("the file ends in column {} of {}: it is truncated", column, header.columns));
      FieldCursor fields{line, CommaRule::Decimal};
      Eigen::RowVector4d p{0, 0, 0, 1};
      for (int axis = 0; axis < 3; ++axis) {
        const auto value = fields.take<double>();
        if (!value)
          return fail(ErrorCode::InvalidInput,
                      fmt::format("line {}: x y z expected{}", lines.line_number(), about_commas(line)));
        p[axis] = *value;
      }
      if (fields.saw_decimal_comma() && !decimal_comma) {
        decimal_comma = true;
        builder.note(ScanRemark::DecimalComma,
                     fmt::format("numbers have a decimal comma: the first line that has is {}", line.substr(0, 60)));
      }
      if (p.head<3>().isZero(0)) {
        builder.add_empty_return();
        continue;
      }
      view.point_at[std::size_t{row} * header.columns + column] = static_cast<std::int32_t>(builder.size());
      builder.add((p * header.pose).head<3>().transpose());
    }
  }
  builder.add_view(std::move(view));
  return {};
}

}  // namespace

bool looks_like_ptx(std::span<const std::byte> bytes) {
  TextCursor lines{as_text(bytes.first(std::min<std::size_t>(bytes.size(), 4096)))};
  return read_header(lines).has_value();
}

Result<ScanFile> read_ptx(std::span<const std::byte> bytes, const ReadOptions& options, const std::stop_token& stop) {
  TextCursor lines{as_text(bytes)};
  ScanBuilder builder{ScanFormat::Ptx, options};
  for (std::size_t scan = 0;; ++scan) {
    TextCursor ahead = lines;
    if (ahead.take_full_line().empty()) break;
    const auto header = read_header(lines);
    if (!header)
      return fail(ErrorCode::InvalidInput,
                  fmt::format("PTX scan {}: line {} is not what the ten header lines ask for (columns, rows, position, "
                              "three axes, a 4x4 matrix)",
                              scan, lines.line_number()));
    if (auto done = read_view(lines, *header, builder, stop); !done)
      return fail_in(fmt::format("PTX scan {}", scan), done.error());
  }
  return std::move(builder).finish();
}

}  // namespace telefab::scan
