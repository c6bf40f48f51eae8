// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <telefab/base/result.hpp>
#include <vector>

#include "scalar_bytes.hpp"

namespace telefab::scan {

/// The property of a vertex that holds PointCloud::sheets_apart.
inline constexpr std::string_view kSheetsApartProperty = "sheets_apart";

enum class PlyEncoding { Ascii, LittleEndian, BigEndian };

struct PlyProperty {
  std::string name;
  ScalarType type = ScalarType::Float32;
  std::optional<ScalarType> count_type;  ///< set for a list
};

struct PlyElement {
  std::string name;
  std::uint64_t count = 0;
  std::vector<PlyProperty> properties;

  [[nodiscard]] bool has_list() const;
  /// The fewest bytes one item can take: exact for binary elements without lists.
  [[nodiscard]] std::uint64_t least_bytes(PlyEncoding encoding) const;
};

struct PlyHeader {
  PlyEncoding encoding = PlyEncoding::Ascii;
  std::vector<PlyElement> elements;
  std::uint32_t grid_columns = 0;  ///< obj_info num_cols, 0 = not stated
  std::uint32_t grid_rows = 0;     ///< obj_info num_rows, 0 = not stated
  std::size_t body_offset = 0;     ///< the first byte behind the header
};

/// Fails with InvalidInput, naming the line.
[[nodiscard]] Result<PlyHeader> read_ply_header(std::string_view text);

}  // namespace telefab::scan
