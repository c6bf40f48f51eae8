// SPDX-License-Identifier: GPL-3.0-or-later
#include <fmt/format.h>

#include <array>
#include <telefab/fab/cure/calibration.hpp>

#include "csv_table.hpp"

namespace telefab::fab {
namespace {

constexpr std::array<std::string_view, 8> kColumns{"test",      "grey",       "row",   "column",
                                                   "period_px", "exposure_s", "value", "unit"};
enum Column : std::size_t { kTest, kGrey, kRow, kColumn, kPeriod, kExposure, kValue, kUnit };

Result<void> read_light(const CsvLine& line, MeasuredRow& row) {
  const std::string_view unit = line.text(kUnit);
  if (unit != "mW/cm2" && unit != "W/m2" && unit != "share")
    return line.refuse(fmt::format("unit is \"{}\"; mW/cm2, W/m2 or share is possible", unit.substr(0, 40)));
  const auto value = line.number(kValue, 0, 1e5);
  if (!value) return tl::unexpected{value.error()};
  row.value = unit == "W/m2" ? *value / 10 : *value;
  row.absolute = unit != "share";
  return {};
}

Result<void> read_into(const CsvLine& line, double& field, std::size_t column, double least, double most) {
  const auto value = line.number(column, least, most);
  if (!value) return tl::unexpected{value.error()};
  field = *value;
  return {};
}

Result<MeasuredRow> read_row(const CsvLine& line) {
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
  constexpr std::array<std::size_t, 3> needed{kTest, kValue, kUnit};
  std::vector<MeasuredRow> rows;
  const auto take = [&](const CsvLine& line) -> Result<void> {
    auto row = read_row(line);
    if (!row) return tl::unexpected{row.error()};
    rows.push_back(*row);
    return {};
  };
  if (auto ok = read_table(text, kColumns, needed, take); !ok) return tl::unexpected{ok.error()};
  return rows;
}

}  // namespace telefab::fab
