// SPDX-License-Identifier: GPL-3.0-or-later
#include <fmt/format.h>
#include <array>
#include <cmath>

#include "readers.hpp"
#include "scan_builder.hpp"
#include "text_cursor.hpp"

namespace telefab::scan {
namespace {

constexpr std::size_t kMaxColumns = 32;

struct Row {
  std::array<double, kMaxColumns> values{};
  std::size_t count = 0;
};

Result<Row> read_row(std::string_view line, std::size_t line_number) {
  Row row;
  FieldCursor fields{line};
  while (!fields.at_end()) {
    const auto value = fields.take<double>();
    if (!value || row.count == kMaxColumns)
      return fail(ErrorCode::InvalidInput,
                  fmt::format("line {}: '{}' is no number; text scans have 3 or more numbers a line", line_number,
                              fields.take_word().substr(0, 40)));
    row.values[row.count++] = *value;
  }
  return row;
}

/// Which three columns are normals: the first three behind the position that are unit vectors in nearly all rows.
class NormalFinder {
 public:
  static constexpr std::array<std::size_t, 3> kStarts{3, 6, 4};
  void look_at(const Row& row) {
    ++rows_;
    for (std::size_t s = 0; s < kStarts.size(); ++s) {
      if (kStarts[s] + 3 > row.count) continue;
      const Vec3 n{row.values[kStarts[s]], row.values[kStarts[s] + 1], row.values[kStarts[s] + 2]};
      const double length = n.norm();
      if (std::abs(length - 1) < 0.05 || length == 0) ++fits_[s];
      if (length > 0.5) ++long_[s];
    }
  }
  [[nodiscard]] std::optional<std::size_t> start() const {
    for (std::size_t s = 0; s < kStarts.size(); ++s)
      if (static_cast<double>(fits_[s]) >= 0.99 * static_cast<double>(rows_) && long_[s] * 2 > rows_) return kStarts[s];
    return std::nullopt;
  }

 private:
  std::size_t rows_ = 0;
  std::array<std::size_t, 3> fits_{};
  std::array<std::size_t, 3> long_{};
};

/// A line of names above the columns, as CSV files have it.
bool is_heading(std::string_view line) {
  FieldCursor fields{line};
  const std::string_view word = fields.take_word();
  return !word.empty() &&
         (word == "x" || word == "X" || word.starts_with("\"x") || word.starts_with("//") || word.starts_with("\"X"));
}

/// Lines of `columns` numbers from where `lines` stands; the first finds out whether there are normals.
std::optional<std::size_t> find_normals(TextCursor lines, std::uint64_t rows) {
  constexpr std::uint64_t kSample = 2000;
  NormalFinder finder;
  for (std::uint64_t i = 0; i < std::min(rows, kSample) && !lines.at_end(); ++i) {
    const std::string_view line = lines.take_full_line();
    if (line.empty()) break;
    if (const auto row = read_row(line, 0)) finder.look_at(*row);
  }
  return finder.start();
}

}  // namespace

Result<ScanFile> read_text(std::span<const std::byte> bytes, const ReadOptions& options, const std::stop_token& stop) {
  const std::string_view text = as_text(bytes);
  if (text.substr(0, 4096).find('\0') != std::string_view::npos)
    return fail(ErrorCode::InvalidInput, "the format is not known: neither PLY, PCD, PTX, OFF, STL, OBJ nor text");
  ScanBuilder builder{ScanFormat::Text, options};
  TextCursor lines{text};
  TextCursor ahead = lines;
  std::string_view first = ahead.take_full_line();
  if (is_heading(first)) {
    lines = ahead;
    first = ahead.take_full_line();
  }
  if (first.empty()) return fail(ErrorCode::InvalidInput, "the file holds no point");
  const auto head = read_row(first, ahead.line_number());
  if (!head) return tl::unexpected{head.error()};

  // A count in a line of its own: PTS (count lines of points) or PWN (points, then as many lines of normals).
  std::optional<std::uint64_t> count;
  if (head->count == 1) {
    const double claimed = head->values[0];
    if (!(claimed >= 0) || claimed > 9e15 || claimed != std::floor(claimed))
      return fail(ErrorCode::InvalidInput,
                  fmt::format("line {}: {} is no number of points", ahead.line_number(), claimed));
    count = static_cast<std::uint64_t>(claimed);
    lines = ahead;
    if (auto room = builder.expect(*count, lines.bytes_left() + 1, 6); !room) return tl::unexpected{room.error()};
  }

  const std::optional<std::size_t> normals_at = find_normals(lines, count.value_or(UINT64_MAX));
  std::size_t columns = 0;
  bool trailing_normals = false;
  for (std::uint64_t i = 0;; ++i) {
    if (i % kStopEvery == 0 && stop.stop_requested()) return fail(ErrorCode::Cancelled, "stopped while reading points");
    const std::string_view line = lines.take_full_line();
    if (line.empty()) break;
    const auto row = read_row(line, lines.line_number());
    if (!row) return tl::unexpected{row.error()};
    if (columns == 0) columns = row->count;
    if (row->count != columns || columns < 3)
      return fail(ErrorCode::InvalidInput,
                  fmt::format("line {} has {} numbers; {} are needed", lines.line_number(), row->count,
                              columns < 3 ? std::string{"3 or more"} : std::to_string(columns)));
    const auto vec = [&](std::size_t at) { return Vec3{row->values[at], row->values[at + 1], row->values[at + 2]}; };
    if (count && i >= *count) {
      if (columns != 3 || i >= 2 * *count)
        return fail(ErrorCode::InvalidInput,
                    fmt::format("line {}: more lines than the {} points stated", lines.line_number(), *count));
      trailing_normals = true;
      builder.add_normal(vec(0));
      continue;
    }
    builder.add(vec(0));
    if (normals_at) builder.add_normal(vec(*normals_at));
  }
  if (count && builder.size() < *count)
    return fail(ErrorCode::InvalidInput,
                fmt::format("the file ends after {} of {} points: it is truncated", builder.size(), *count));
  auto file = std::move(builder).finish();
  if (file && trailing_normals && !file->cloud.has_normals())
    return fail(ErrorCode::InvalidInput, fmt::format("the file ends within the {} normals: it is truncated", *count));
  return file;
}

}  // namespace telefab::scan
