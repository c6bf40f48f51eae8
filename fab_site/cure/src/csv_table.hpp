// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <functional>
#include <span>
#include <string>
#include <string_view>
#include <telefab/base/result.hpp>
#include <vector>

namespace telefab::fab {

/// One line of a table of measurements; columns by their place in the list that read_table() was given.
class CsvLine {
 public:
  CsvLine(std::size_t number, std::span<const std::string_view> columns, std::vector<std::string_view> cells,
          std::span<const std::size_t> places)
      : number_{number}, columns_{columns}, cells_{std::move(cells)}, places_{places} {}

  /// Empty where the file has no such column or the line no such cell.
  [[nodiscard]] std::string_view text(std::size_t column) const;
  /// InvalidInput with the line.
  [[nodiscard]] tl::unexpected<Error> refuse(std::string what) const;
  [[nodiscard]] Result<double> number(std::size_t column, double least, double most) const;
  [[nodiscard]] Result<int> whole(std::size_t column, int most) const;

 private:
  std::size_t number_;
  std::span<const std::string_view> columns_;
  std::vector<std::string_view> cells_;
  std::span<const std::size_t> places_;  ///< of each column in the file
};

/// Comma-separated text with a header that names columns in any order; lines that start with # are left out. `needed`
/// must be there. Fails with InvalidInput (line, column, what is wrong; nothing in it), TooLarge, and as `take`.
[[nodiscard]] Result<void> read_table(std::string_view text, std::span<const std::string_view> columns,
                                      std::span<const std::size_t> needed,
                                      const std::function<Result<void>(const CsvLine&)>& take);

}  // namespace telefab::fab
