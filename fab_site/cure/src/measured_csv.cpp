// SPDX-License-Identifier: GPL-3.0-or-later
#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <charconv>
#include <cmath>
#include <telefab/fab/cure/calibration.hpp>

namespace telefab::fab {
namespace {

constexpr std::array<std::string_view, 8> kColumns{"test",      "grey",       "row",   "column",
                                                   "period_px", "exposure_s", "value", "unit"};
enum Column : std::size_t { kTest, kGrey, kRow, kColumn, kPeriod, kExposure, kValue, kUnit };
constexpr std::size_t kMostRows = 100'000;

std::string_view trimmed(std::string_view text) {
  const auto first = text.find_first_not_of(" \t\r\"");
  if (first == std::string_view::npos) return {};
  return text.substr(first, text.find_last_not_of(" \t\r\"") - first + 1);
}

std::vector<std::string_view> cells_of(std::string_view line) {
  std::vector<std::string_view> cells;
  for (std::size_t from = 0;;) {
    const auto comma = line.find(',', from);
    cells.push_back(trimmed(line.substr(from, comma == std::string_view::npos ? comma : comma - from)));
    if (comma == std::string_view::npos) return cells;
    from = comma + 1;
  }
}

/// Where each known column stands in the file; npos where it does not.
using Places = std::array<std::size_t, kColumns.size()>;

Result<Places> places_of(std::string_view header) {
  Places places;
  places.fill(std::string_view::npos);
  const auto names = cells_of(header);
  for (std::size_t i = 0; i < names.size(); ++i) {
    const auto known = std::find(kColumns.begin(), kColumns.end(), names[i]);
    if (known == kColumns.end())
      return fail(ErrorCode::InvalidInput,
                  fmt::format("line 1: unknown column \"{}\"; there are: {}", names[i], fmt::join(kColumns, ", ")));
    places[static_cast<std::size_t>(known - kColumns.begin())] = i;
  }
  for (const Column column : {kTest, kValue, kUnit})
    if (places[column] == std::string_view::npos)
      return fail(ErrorCode::InvalidInput, fmt::format("line 1: there is no column \"{}\"", kColumns[column]));
  return places;
}

/// One line of the file; numbers with their ranges.
class Line {
 public:
  Line(std::size_t number, std::vector<std::string_view> cells, const Places& places)
      : number_{number}, cells_{std::move(cells)}, places_{places} {}

  [[nodiscard]] std::string_view text(Column column) const {
    return places_[column] < cells_.size() ? cells_[places_[column]] : std::string_view{};
  }
  [[nodiscard]] tl::unexpected<Error> refuse(std::string what) const {
    return fail(ErrorCode::InvalidInput, fmt::format("line {}: {}", number_, what));
  }
  [[nodiscard]] Result<double> number(Column column, double least, double most) const {
    const std::string_view cell = text(column);
    if (cell.empty()) return refuse(fmt::format("{} is empty; fill it in or delete the row", kColumns[column]));
    double value = 0;
    const auto [end, error] = std::from_chars(cell.data(), cell.data() + cell.size(), value);
    if (error != std::errc{} || end != cell.data() + cell.size() || !std::isfinite(value))
      return refuse(fmt::format("{} is \"{}\", not a number", kColumns[column], cell.substr(0, 40)));
    if (value < least || value > most)
      return refuse(fmt::format("{} is {}; {} to {} is possible", kColumns[column], value, least, most));
    return value;
  }
  [[nodiscard]] Result<int> whole(Column column, int most) const {
    const auto value = number(column, 0, most);
    if (!value) return tl::unexpected{value.error()};
    if (*value != std::floor(*value)) return refuse(fmt::format("{} is {}, not whole", kColumns[column], *value));
    return static_cast<int>(*value);
  }

 private:
  std::size_t number_;
  std::vector<std::string_view> cells_;
  const Places& places_;
};

Result<void> read_light(const Line& line, MeasuredRow& row) {
  const std::string_view unit = line.text(kUnit);
  if (unit != "mW/cm2" && unit != "W/m2" && unit != "share")
    return line.refuse(fmt::format("unit is \"{}\"; mW/cm2, W/m2 or share is possible", unit.substr(0, 40)));
  const auto value = line.number(kValue, 0, 1e5);
  if (!value) return tl::unexpected{value.error()};
  row.value = unit == "W/m2" ? *value / 10 : *value;
  row.absolute = unit != "share";
  return {};
}

Result<void> read_into(const Line& line, double& field, Column column, double least, double most) {
  const auto value = line.number(column, least, most);
  if (!value) return tl::unexpected{value.error()};
  field = *value;
  return {};
}

Result<MeasuredRow> read_row(const Line& line) {
  MeasuredRow row;
  const std::string_view test = line.text(kTest), unit = line.text(kUnit);
  Result<void> read;
  if (test == "wedge") {
    row.test = MeasuredRow::Test::Wedge;
    read = read_into(line, row.grey, kGrey, 0, 255);
    if (read) read = read_light(line, row);
  } else if (test == "field") {
    row.test = MeasuredRow::Test::Field;
    const auto at_row = line.whole(kRow, 63), at_column = line.whole(kColumn, 63);
    if (!at_row) return tl::unexpected{at_row.error()};
    if (!at_column) return tl::unexpected{at_column.error()};
    row.row = *at_row;
    row.column = *at_column;
    read = read_light(line, row);
  } else if (test == "lines") {
    row.test = MeasuredRow::Test::Lines;
    if (unit != "contrast") return line.refuse("the unit of lines is contrast");
    read = read_into(line, row.period_px, kPeriod, 2, 1000);
    if (read) read = read_into(line, row.value, kValue, 0, 1);
  } else if (test == "depth") {
    row.test = MeasuredRow::Test::Depth;
    if (unit != "mm" && unit != "um") return line.refuse("the unit of depth is mm or um");
    read = read_into(line, row.exposure_s, kExposure, 1e-4, 1e5);
    if (read) read = read_into(line, row.value, kValue, 1e-6, 1e5);
    if (unit == "um") row.value /= 1000;
  } else {
    return line.refuse(fmt::format("unknown test \"{}\"; there are: wedge, field, lines, depth", test.substr(0, 40)));
  }
  if (!read) return tl::unexpected{read.error()};
  return row;
}

}  // namespace

Result<std::vector<MeasuredRow>> measured_from_csv(std::string_view text) {
  if (text.starts_with("\xef\xbb\xbf")) text.remove_prefix(3);  // spreadsheets mark UTF-8 so
  std::vector<MeasuredRow> rows;
  std::optional<Places> places;
  for (std::size_t number = 1; !text.empty(); ++number) {
    const auto end = std::min(text.find('\n'), text.size());
    const std::string_view content = trimmed(text.substr(0, end));
    const std::string_view line = text.substr(0, end);
    text.remove_prefix(std::min(end + 1, text.size()));
    if (content.empty() || content.starts_with('#')) continue;
    if (!places) {
      auto found = places_of(line);
      if (!found) return tl::unexpected{found.error()};
      places = *found;
      continue;
    }
    if (rows.size() == kMostRows) return fail(ErrorCode::TooLarge, fmt::format("more than {} measurements", kMostRows));
    auto row = read_row(Line{number, cells_of(line), *places});
    if (!row) return tl::unexpected{row.error()};
    rows.push_back(*row);
  }
  if (rows.empty()) return fail(ErrorCode::InvalidInput, "there is no measurement in it");
  return rows;
}

}  // namespace telefab::fab
