// SPDX-License-Identifier: GPL-3.0-or-later
#include <fmt/format.h>
#include <array>
#include <cmath>
#include <telefab/job/readable_scans.hpp>

#include "readers.hpp"
#include "scan_builder.hpp"
#include "text_columns.hpp"
#include "text_cursor.hpp"
#include "text_table.hpp"

// XYZ, PTS, PWN, CSV and their kin: a title or none, a count or none, then one point a line.
namespace telefab::scan {
namespace {

constexpr std::size_t kAsked = 500;  ///< lines that tell how the others are to be read

bool is_comment(std::string_view line) { return line.starts_with('#') || line.starts_with("//"); }

/// The next line with something to read: no comment, nothing blank. Empty at the end.
TextLine next_line(TextCursor& lines) {
  while (!lines.at_end()) {
    const std::string_view line = lines.take_full_line();
    if (!line.empty() && !is_comment(line)) return {line, lines.line_number()};
  }
  return {};
}

/// What stands above the numbers.
struct Prologue {
  std::optional<std::string_view> title;
  std::size_t title_line = 0;
  bool title_is_comment = false;
  TextCursor body;
};

Prologue read_prologue(std::string_view text) {
  Prologue found{std::nullopt, 0, false, TextCursor{text}};
  TextCursor lines{text};
  std::optional<std::string_view> comment;
  while (!lines.at_end()) {
    const TextCursor before = lines;
    std::string_view line = lines.take_line();
    line.remove_prefix(std::min(line.size(), line.find_first_not_of(" \t")));
    if (line.empty() || line.starts_with("sep=")) {
      found.body = lines;
      continue;
    }
    if (is_comment(line)) {
      if (names_positions(line)) comment = line;
      continue;
    }
    if (is_title(line)) {
      found.title = line;
      found.title_line = lines.line_number();
      found.body = lines;
    } else {
      found.body = before;
      if (comment) found.title = comment, found.title_is_comment = true;
    }
    return found;
  }
  found.body = lines;
  return found;
}

std::vector<TextLine> sample_of(TextCursor lines, std::uint64_t most) {
  std::vector<TextLine> sample;
  while (sample.size() < std::min<std::uint64_t>(most, kAsked)) {
    const TextLine line = next_line(lines);
    if (line.text.empty()) break;
    sample.push_back(line);
  }
  return sample;
}

/// The count that stands alone in a line of PTS and PWN files.
std::optional<double> lone_number(std::string_view line) {
  std::vector<std::string_view> cells;
  split_cells(line, TextDialect{}, cells);
  return cells.size() == 1 ? number_of(cells[0], {}) : std::nullopt;
}

Result<std::uint64_t> count_from(double claimed, std::size_t line) {
  if (!(claimed >= 0) || claimed > 9e15 || claimed != std::floor(claimed))
    return fail(ErrorCode::InvalidInput, fmt::format("line {}: {} is not a number of points", line, claimed));
  return static_cast<std::uint64_t>(claimed);
}

class TextReader {
 public:
  TextReader(const ReadOptions& options, const std::stop_token& stop)
      : builder_{ScanFormat::Text, options}, stop_{stop} {}

  Result<ScanFile> read(std::string_view text) {
    const Prologue prologue = read_prologue(text);
    TextCursor lines = prologue.body;
    TextCursor ahead = lines;
    const TextLine first = next_line(ahead);
    if (first.text.empty() && prologue.title && !prologue.title_is_comment)
      return not_a_number(prologue.title_line, *prologue.title);
    if (first.text.empty()) return fail(ErrorCode::InvalidInput, "the file holds no point");
    if (const auto claimed = lone_number(first.text)) {
      lines = ahead;
      if (auto begun = begin_section(*claimed, first.number, lines); !begun) return tl::unexpected{begun.error()};
    }
    const std::vector<TextLine> sample = sample_of(lines, count_.value_or(UINT64_MAX));
    if (auto known = learn(prologue, sample); !known) return tl::unexpected{known.error()};
    if (count_ && columns_ == 3) builder_.points_are_named();  // normals may stand behind all of them (PWN)
    if (auto taken = take_lines(lines); !taken) return tl::unexpected{taken.error()};
    return finish();
  }

 private:
  Result<void> begin_section(double claimed, std::size_t line, const TextCursor& lines) {
    const auto count = count_from(claimed, line);
    if (!count) return tl::unexpected{count.error()};
    count_ = *count;
    in_section_ = 0;
    ++sections_;
    return builder_.expect(*count, lines.bytes_left() + 1, 6);
  }

  /// How the lines are to be read, from the first of them.
  Result<void> learn(const Prologue& prologue, std::span<const TextLine> sample) {
    if (sample.empty()) return {};
    const auto dialect = dialect_of(sample);
    if (!dialect) return tl::unexpected{dialect.error()};
    dialect_ = *dialect;
    split_cells(sample[0].text, dialect_, cells_);
    while (cells_.size() > 3 && cells_.back().empty()) cells_.pop_back();
    columns_ = cells_.size();
    if (prologue.title) {
      auto by_title = columns_by_title(*prologue.title, dialect_, columns_);
      // A comment may be about anything; a line without its mark is a title.
      if (!by_title && !prologue.title_is_comment) {
        if (sample[0].number > 0 && is_title(sample[0].text)) return not_a_number(sample[0].number, sample[0].text);
        return tl::unexpected{by_title.error()};
      }
      if (by_title) where_ = std::move(*by_title);
      titled_ = by_title.has_value();
    }
    if (columns_ < 3)
      return fail(ErrorCode::InvalidInput,
                  fmt::format("line {} has {} numbers; 3 or more are needed", sample[0].number, columns_));
    if (!titled_) {
      if (auto numbers = expect_numbers(sample); !numbers) return numbers;
      where_ = columns_by_numbers(sample, dialect_);
    }
    if (dialect_.decimal_comma)
      builder_.note(ScanRemark::DecimalComma,
                    fmt::format("numbers have a decimal comma: {} is read as such", cells_[where_.position[0]]));
    for (ScanNote& note : where_.notes) builder_.note(note.remark, std::move(note.text));
    if (where_.unit_mm) builder_.state_unit(*where_.unit_mm);
    return {};
  }

  /// Without titles every column must hold numbers, or there is no telling which is which.
  Result<void> expect_numbers(std::span<const TextLine> sample) {
    std::vector<std::string_view> cells;
    for (const TextLine& line : sample) {
      split_cells(line.text, dialect_, cells);
      for (const std::string_view cell : cells)
        if (!number_of(cell, dialect_)) return not_a_number(line.number, cell);
    }
    return {};
  }

  static tl::unexpected<Error> not_a_number(std::size_t line, std::string_view word) {
    return fail(ErrorCode::InvalidInput,
                fmt::format("line {}: '{}' is not a number; text scans have 3 or more numbers a line, or titles above "
                            "their columns",
                            line, word.substr(0, 40)));
  }

  Result<void> take_lines(TextCursor& lines) {
    for (std::uint64_t i = 0;; ++i) {
      if (i % kStopEvery == 0 && stop_.stop_requested()) return cancelled("reading points");
      const TextLine line = next_line(lines);
      if (line.text.empty()) return {};
      if (count_ && in_section_ >= *count_)
        if (const auto claimed = lone_number(line.text)) {
          if (auto begun = begin_section(*claimed, line.number, lines); !begun) return begun;
          continue;
        }
      if (auto taken = take(line); !taken) return taken;
    }
  }

  Result<void> take(const TextLine& line) {
    split_cells(line.text, dialect_, cells_);
    while (cells_.size() > columns_ && cells_.back().empty()) cells_.pop_back();
    if (cells_.size() != columns_) {
      for (const std::string_view cell : cells_)
        if (!titled_ && !number_of(cell, dialect_)) return not_a_number(line.number, cell);
      return fail(ErrorCode::InvalidInput,
                  fmt::format("line {} has {} numbers; {} are needed", line.number, cells_.size(), columns_));
    }
    if (count_ && in_section_ >= *count_) return take_trailing_normal(line);
    ++in_section_;
    auto position = triple(line, where_.position);
    if (!position) return tl::unexpected{position.error()};
    builder_.add(*position);
    if (!where_.normal) return {};
    auto normal = triple(line, *where_.normal);
    if (!normal) return tl::unexpected{normal.error()};
    builder_.add_normal(*normal);
    return {};
  }

  /// PWN: behind the points stand as many lines of normals.
  Result<void> take_trailing_normal(const TextLine& line) {
    if (columns_ != 3 || sections_ > 1 || trailing_normals_ >= *count_)
      return fail(ErrorCode::InvalidInput,
                  fmt::format("line {}: more lines than the {} points stated", line.number, *count_));
    auto normal = triple(line, {0, 1, 2});
    if (!normal) return tl::unexpected{normal.error()};
    ++trailing_normals_;
    builder_.add_normal(*normal);
    return {};
  }

  Result<Vec3> triple(const TextLine& line, const std::array<std::size_t, 3>& at) const {
    Vec3 v;
    for (std::size_t axis = 0; axis < 3; ++axis) {
      const auto value = number_of(cells_[at[axis]], dialect_);
      if (!value) return not_a_number(line.number, cells_[at[axis]]);
      v[static_cast<int>(axis)] = *value;
    }
    return v;
  }

  Result<ScanFile> finish() {
    if (count_ && in_section_ < *count_)
      return fail(ErrorCode::InvalidInput,
                  fmt::format("the file ends after {} of {} points: it is truncated", in_section_, *count_));
    if (trailing_normals_ > 0 && trailing_normals_ < *count_)
      return fail(ErrorCode::InvalidInput,
                  fmt::format("the file ends within the {} normals: it is truncated", *count_));
    if (sections_ > 1)
      builder_.note(ScanRemark::SeveralScans,
                    fmt::format("the file holds {} scans, one after the other; all are taken", sections_));
    return std::move(builder_).finish();
  }

  ScanBuilder builder_;
  const std::stop_token& stop_;
  TextDialect dialect_;
  TextColumns where_;
  bool titled_ = false;
  std::size_t columns_ = 0;
  std::optional<std::uint64_t> count_;  ///< of the section being read
  std::uint64_t in_section_ = 0;
  std::size_t sections_ = 0;
  std::uint64_t trailing_normals_ = 0;
  std::vector<std::string_view> cells_;
};

}  // namespace

Result<ScanFile> read_text(std::span<const std::byte> bytes, const ReadOptions& options, const std::stop_token& stop) {
  const std::string_view text = as_text(bytes);
  if (text.substr(0, 4096).find('\0') != std::string_view::npos)
    return fail(ErrorCode::InvalidInput, fmt::format("the format is not known: no {}", kReadableScans));
  return TextReader{options, stop}.read(text);
}

}  // namespace telefab::scan
