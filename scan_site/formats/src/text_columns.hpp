// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <array>
#include <cstddef>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <telefab/base/result.hpp>
#include <telefab/scan/cloud/point_cloud.hpp>
#include <vector>

#include "text_table.hpp"

namespace telefab::scan {

/// Which column of a text holds what.
struct TextColumns {
  std::array<std::size_t, 3> position{0, 1, 2};
  std::optional<std::array<std::size_t, 3>> normal;
  std::optional<double> unit_mm;  ///< where the titles state it: "X [mm]"
  std::vector<ScanNote> notes;
};

/// Whether the line has words where numbers are expected.
[[nodiscard]] bool is_title(std::string_view line);
/// Whether the words of a comment name x, y and z once each: then it may be the title.
[[nodiscard]] bool names_positions(std::string_view comment);

/// Columns by their titles, in any order, capitals or not: "x", "X [mm]", "Point X", "//X", "Points:0", "easting", and
/// normals as "nx", "normal_x", "Normals:0". Fails: InvalidInput (no x, y or z, or two; more or fewer titles than
/// columns).
[[nodiscard]] Result<TextColumns> columns_by_title(std::string_view title, const TextDialect& dialect,
                                                   std::size_t columns);

/// Columns without titles: x, y and z first, behind a running number if there is one; normals are the first three
/// columns behind them that are unit vectors in nearly all lines and can be no colour.
[[nodiscard]] TextColumns columns_by_numbers(std::span<const TextLine> lines, const TextDialect& dialect);

}  // namespace telefab::scan
