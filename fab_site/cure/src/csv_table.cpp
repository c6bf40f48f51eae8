// SPDX-License-Identifier: GPL-3.0-or-later
#include "csv_table.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <charconv>
#include <cmath>
#include <optional>

namespace telefab::fab {
namespace {

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
Result<std::vector<std::size_t>> places_of(std::string_view header, std::span<const std::string_view> columns,
                                           std::span<const std::size_t> needed) {
  std::vector<std::size_t> places(columns.size(), std::string_view::npos);
  const auto names = cells_of(header);
  for (std::size_t i = 0; i < names.size(); ++i) {
    const auto known = std::find(columns.begin(), columns.end(), names[i]);
    if (known == columns.end())
      return fail(ErrorCode::InvalidInput,
                  fmt::format("line 1: unknown column \"{}\"; there are: {}", names[i], fmt::join(columns, ", ")));
    places[static_cast<std::size_t>(known - columns.begin())] = i;
  }
  for (const std::size_t column : needed)
    if (places[column] == std::string_view::npos)
      return fail(ErrorCode::InvalidInput, fmt::format("line 1: there is no column \"{}\"", columns[column]));
  return places;
}

}  // namespace

std::string_view CsvLine::text(std::size_t column) const {
  return places_[column] < cells_.size() ? cells_[places_[column]] : std::string_view{};
}

tl::unexpected<Error> CsvLine::refuse(std::string what) const {
  return fail(ErrorCode::InvalidInput, fmt::format("line {}: {}", number_, what));
}

Result<double> CsvLine::number(std::size_t column, double least, double most) const {
  const std::string_view cell = text(column);
  if (cell.empty()) return refuse(fmt::format("{} is empty; fill it in or delete the row", columns_[column]));
  double value = 0;
  const auto [end, error] = std::from_chars(cell.data(), cell.data() + cell.size(), value);
  if (error != std::errc{} || end != cell.data() + cell.size() || !std::isfinite(value))
    return refuse(fmt::format("{} is \"{}\", not a number", columns_[column], cell.substr(0, 40)));
  if (value < least || value > most)
    return refuse(fmt::format("{} is {}; {} to {} is possible", columns_[column], value, least, most));
  return value;
}

Result<int> CsvLine::whole(std::size_t column, int most) const {
  const auto value = number(column, 0, most);
  if (!value) return tl::unexpected{value.error()};
  if (*value != std::floor(*value)) return refuse(fmt::format("{} is {}, not whole", columns_[column], *value));
  return static_cast<int>(*value);
}

Result<void> read_table(std::string_view text, std::span<const std::string_view> columns,
                        std::span<const std::size_t> needed, const std::function<Result<void>(const CsvLine&)>& take) {
  if (text.starts_with("\xef\xbb\xbf")) text.remove_prefix(3);  // spreadsheets mark UTF-8 so
  std::optional<std::vector<std::size_t>> places;
  std::size_t rows = 0;
  for (std::size_t number = 1; !text.empty(); ++number) {
    const auto end = std::min(text.find('\n'), text.size());
    const std::string_view content = trimmed(text.substr(0, end));
    const std::string_view line = text.substr(0, end);
    text.remove_prefix(std::min(end + 1, text.size()));
    if (content.empty() || content.starts_with('#')) continue;
    if (!places) {
      auto found = places_of(line, columns, needed);
      if (!found) return tl::unexpected{found.error()};
      places = std::move(*found);
      continue;
    }
    if (rows++ == kMostRows) return fail(ErrorCode::TooLarge, fmt::format("more than {} measurements", kMostRows));
    if (auto ok = take(CsvLine{number, columns, cells_of(line), *places}); !ok) return ok;
  }
  if (rows == 0) return fail(ErrorCode::InvalidInput, "there is no measurement in it");
  return {};
}

}  // namespace telefab::fab
