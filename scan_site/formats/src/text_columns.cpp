// SPDX-License-Identifier: GPL-3.0-or-later
#include "text_columns.hpp"

#include <fmt/format.h>
#include <algorithm>
#include <cctype>
#include <cmath>
#include <telefab/scan/cloud/units.hpp>

namespace telefab::scan {
namespace {

constexpr std::size_t kFewRows = 8;       ///< of fewer it cannot be said that they are all the same by a mistake
constexpr std::size_t kCountedRows = 10;  ///< a first column that counts so many lines is their number

/// A title, stripped to what it names: small letters and digits.
struct Title {
  std::string name;
  std::optional<double> unit_mm;
};

/// Takes "[mm]" or "(m)" out of a text and says what it was.
std::string without_units(std::string_view text, std::optional<double>& unit_mm) {
  std::string left;
  while (true) {
    const std::size_t open = text.find_first_of("[(");
    const std::size_t close = open == std::string_view::npos ? open : text.find_first_of("])", open);
    left += text.substr(0, open);
    if (close == std::string_view::npos) return left;
    if (const auto unit = millimetres_per(text.substr(open + 1, close - open - 1))) unit_mm = *unit;
    text.remove_prefix(close + 1);
  }
}

Title title_from(std::string_view text) {
  Title title;
  for (const char c : without_units(text, title.unit_mm))
    if (std::isalnum(static_cast<unsigned char>(c)))
      title.name += static_cast<char>(std::tolower(static_cast<unsigned char>(c)));
  return title;
}

/// 0, 1 or 2 if the name is one of an axis' names: the axis letter or number behind or before one of the words.
std::optional<std::size_t> axis_named(std::string_view name, std::span<const std::string_view> words) {
  static constexpr std::array<std::string_view, 3> kLetters{"x", "y", "z"}, kNumbers{"0", "1", "2"};
  for (std::size_t axis = 0; axis < 3; ++axis)
    for (const std::string_view word : words) {
      if (name.size() == word.size() + 1 && name.starts_with(word) && name.ends_with(kLetters[axis])) return axis;
      if (name.size() == word.size() + 1 && name.starts_with(kLetters[axis]) && name.ends_with(word)) return axis;
      if (word.size() > 1 && name.size() == word.size() + 1 && name.starts_with(word) && name.ends_with(kNumbers[axis]))
        return axis;
    }
  return std::nullopt;
}

std::optional<std::size_t> position_axis(std::string_view name) {
  static constexpr std::array<std::string_view, 11> kWords{
      "", "point", "points", "pos", "position", "positions", "coord", "coordinate", "coordinates", "cartesian", "p"};
  static constexpr std::array<std::pair<std::string_view, std::size_t>, 8> kMaps{{{"easting", 0},
                                                                                  {"east", 0},
                                                                                  {"northing", 1},
                                                                                  {"north", 1},
                                                                                  {"elevation", 2},
                                                                                  {"height", 2},
                                                                                  {"altitude", 2},
                                                                                  {"elev", 2}}};
  for (const auto& [word, axis] : kMaps)
    if (name == word) return axis;
  return axis_named(name, kWords);
}

std::optional<std::size_t> normal_axis(std::string_view name) {
  static constexpr std::array<std::string_view, 4> kWords{"n", "normal", "normals", "norm"};
  return axis_named(name, kWords);
}

struct Named {
  std::array<std::vector<std::size_t>, 3> position, normal;
  [[nodiscard]] bool has_position() const {
    return std::all_of(position.begin(), position.end(), [](const auto& at) { return at.size() == 1; });
  }
};

Named named_columns(std::span<const Title> titles) {
  Named named;
  for (std::size_t i = 0; i < titles.size(); ++i) {
    if (const auto axis = position_axis(titles[i].name)) named.position[*axis].push_back(i);
    if (const auto axis = normal_axis(titles[i].name)) named.normal[*axis].push_back(i);
  }
  return named;
}

std::vector<Title> titles_of(std::string_view line, const TextDialect& dialect) {
  while (!line.empty() && (line.front() == '/' || line.front() == '#' || line.front() == ' ')) line.remove_prefix(1);
  std::vector<std::string_view> cells;
  std::vector<Title> titles;
  if (dialect.mark == CellMark::Comma || dialect.mark == CellMark::Semicolon || dialect.mark == CellMark::Tab) {
    split_cells(line, dialect, cells);
    for (const std::string_view cell : cells) titles.push_back(title_from(cell));
    return titles;
  }
  std::optional<double> unit_mm;
  const std::string plain = without_units(line, unit_mm);
  split_cells(plain, TextDialect{}, cells);
  for (const std::string_view cell : cells) titles.push_back({title_from(cell).name, unit_mm});
  return titles;
}

/// "Point X Point Y Point Z": two words a column.
std::vector<Title> in_pairs(const std::vector<Title>& titles) {
  std::vector<Title> pairs;
  for (std::size_t i = 0; i + 1 < titles.size(); i += 2)
    pairs.push_back({titles[i].name + titles[i + 1].name, titles[i].unit_mm});
  return pairs;
}

using Row = std::vector<std::optional<double>>;

std::vector<Row> rows_of(std::span<const TextLine> lines, const TextDialect& dialect) {
  std::vector<Row> rows;
  std::vector<std::string_view> cells;
  for (const TextLine& line : lines) {
    split_cells(line.text, dialect, cells);
    Row row;
    for (const std::string_view cell : cells) row.push_back(number_of(cell, dialect));
    if (rows.empty() || row.size() == rows.front().size()) rows.push_back(std::move(row));
  }
  return rows;
}

bool counts_rows(std::span<const Row> rows) {
  if (rows.size() < kCountedRows || rows.front().size() < 4) return false;
  const auto first = rows.front()[0];
  if (!first || *first != std::floor(*first)) return false;
  for (std::size_t i = 0; i < rows.size(); ++i)
    if (!rows[i][0] || *rows[i][0] != *first + static_cast<double>(i)) return false;
  return true;
}

enum class Triple { Other, Normals, Colours };

/// What the three columns from `at` on hold.
Triple kind_of(std::span<const Row> rows, std::size_t at) {
  std::size_t fits = 0, longer = 0;
  bool varies = false, has_negative = false;
  std::optional<Vec3> first;
  for (const Row& row : rows) {
    if (!row[at] || !row[at + 1] || !row[at + 2]) return Triple::Other;
    const Vec3 n{*row[at], *row[at + 1], *row[at + 2]};
    const double length = n.norm();
    fits += std::abs(length - 1) < 0.05 || length == 0 || std::isnan(length) ? 1 : 0;
    longer += length > 0.5 ? 1 : 0;
    if (!first && length > 0.5) first = n;
    varies |= first && length > 0.5 && (n - *first).norm() > 1e-3;
    has_negative |= n.minCoeff() < -1e-6;
  }
  if (static_cast<double>(fits) < 0.99 * static_cast<double>(rows.size()) || longer * 2 <= rows.size())
    return Triple::Other;
  return rows.size() < kFewRows || (varies && has_negative) ? Triple::Normals : Triple::Colours;
}

}  // namespace

bool is_title(std::string_view line) {
  std::vector<std::string_view> cells;
  split_cells(line, TextDialect{}, cells);
  std::size_t words = 0;
  for (const std::string_view cell : cells) words += number_of(cell, {}) ? 0 : 1;
  return 2 * words > cells.size();
}

bool names_positions(std::string_view comment) {
  const std::vector<Title> titles = titles_of(comment, TextDialect{});
  return named_columns(titles).has_position() || named_columns(in_pairs(titles)).has_position();
}

Result<TextColumns> columns_by_title(std::string_view title, const TextDialect& dialect, std::size_t columns) {
  const auto quoted = [&] { return title.substr(0, 80); };
  std::vector<Title> titles = titles_of(title, dialect);
  if (titles.size() != columns) titles = titles_of(title, TextDialect{});
  if (titles.size() == 2 * columns && named_columns(in_pairs(titles)).has_position()) titles = in_pairs(titles);
  while (titles.size() > columns && titles.back().name.empty()) titles.pop_back();
  if (2 * titles.size() == columns && dialect.mark == CellMark::Comma)
    return fail(
        ErrorCode::InvalidInput,
        fmt::format("{} titles ({}) stand over {} columns: the numbers seem to have a decimal comma, and commas "
                    "between them too; write them with a decimal point",
                    titles.size(), quoted(), columns));
  if (titles.size() != columns)
    return fail(ErrorCode::InvalidInput,
                fmt::format("{} titles ({}) stand over {} columns, so that none can be told; give every column one",
                            titles.size(), quoted(), columns));
  const Named named = named_columns(titles);
  if (!named.has_position())
    return fail(
        ErrorCode::InvalidInput,
        fmt::format("the titles ({}) do not name x, y and z once each; rename the columns of the positions", quoted()));
  TextColumns found;
  for (std::size_t axis = 0; axis < 3; ++axis) found.position[axis] = named.position[axis][0];
  if (std::all_of(named.normal.begin(), named.normal.end(), [](const auto& at) { return at.size() == 1; }))
    found.normal = {named.normal[0][0], named.normal[1][0], named.normal[2][0]};
  const auto unit = [&](std::size_t axis) { return titles[found.position[axis]].unit_mm; };
  if (unit(0) && unit(0) == unit(1) && unit(0) == unit(2)) found.unit_mm = unit(0);
  return found;
}

TextColumns columns_by_numbers(std::span<const TextLine> lines, const TextDialect& dialect) {
  TextColumns found;
  const std::vector<Row> rows = rows_of(lines, dialect);
  if (rows.empty()) return found;
  const std::size_t columns = rows.front().size();
  std::size_t from = 3;
  if (counts_rows(rows)) {
    found.position = {1, 2, 3};
    from = 4;
    found.notes.push_back({ScanRemark::GuessedColumns,
                           "the first column counts the lines and is left out: x, y and z are columns 2 to 4"});
  }
  for (const std::size_t behind : {std::size_t{0}, std::size_t{3}, std::size_t{1}, std::size_t{4}}) {
    const std::size_t at = from + behind;
    if (at + 3 > columns || found.normal) continue;
    const Triple kind = kind_of(rows, at);
    if (kind == Triple::Normals) found.normal = {at, at + 1, at + 2};
    if (kind == Triple::Colours)
      found.notes.push_back(
          {ScanRemark::NotNormals,
           fmt::format("columns {} to {} have unit length but are all the same, or never negative: they are taken for "
                       "colours, not for normals",
                       at + 1, at + 3)});
  }
  return found;
}

}  // namespace telefab::scan
