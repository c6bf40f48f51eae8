// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <cstddef>
#include <optional>
#include <span>
#include <string_view>
#include <telefab/base/result.hpp>
#include <vector>

// Numbers in columns, however the lines part them: blanks, tabs, commas, semicolons, decimal commas.
namespace telefab::scan {

/// What parts the cells of a line.
enum class CellMark : char {
  Mixed = 0,  ///< any run of blanks, tabs, commas and semicolons
  Blank = ' ',
  Tab = '\t',
  Comma = ',',
  Semicolon = ';'
};

struct TextDialect {
  CellMark mark = CellMark::Mixed;
  bool decimal_comma = false;
};

/// A data line of the file.
struct TextLine {
  std::string_view text;
  std::size_t number = 0;  ///< from 1
};

/// How these lines are to be read. Fails: InvalidInput where commas may be decimal commas or part the columns, and
/// where numbers have thousands parted.
[[nodiscard]] Result<TextDialect> dialect_of(std::span<const TextLine> lines);

/// The cells of a line, without blanks and quotes about them. Runs of blanks are one mark; commas and semicolons are
/// not, so that a cell may be empty.
void split_cells(std::string_view line, const TextDialect& dialect, std::vector<std::string_view>& cells);

/// The number of a cell; NaN for an empty one and for NA, null, none; nothing for a word.
[[nodiscard]] std::optional<double> number_of(std::string_view cell, const TextDialect& dialect);

}  // namespace telefab::scan
