// SPDX-License-Identifier: GPL-3.0-or-later
#include "ply_header.hpp"

#include <fmt/format.h>
#include <algorithm>
#include <array>
#include <utility>

#include "text_cursor.hpp"

namespace telefab::scan {
namespace {

constexpr std::size_t kMaxHeaderBytes = 1U << 20;

std::optional<ScalarType> type_named(std::string_view name) {
  static constexpr std::array<std::pair<std::string_view, ScalarType>, 18> kNames{{
      {"char", ScalarType::Int8},
      {"int8", ScalarType::Int8},
      {"uchar", ScalarType::Uint8},
      {"uint8", ScalarType::Uint8},
      {"short", ScalarType::Int16},
      {"int16", ScalarType::Int16},
      {"ushort", ScalarType::Uint16},
      {"uint16", ScalarType::Uint16},
      {"int", ScalarType::Int32},
      {"int32", ScalarType::Int32},
      {"uint", ScalarType::Uint32},
      {"uint32", ScalarType::Uint32},
      {"float", ScalarType::Float32},
      {"float32", ScalarType::Float32},
      {"double", ScalarType::Float64},
      {"float64", ScalarType::Float64},
      {"int64", ScalarType::Int64},
      {"uint64", ScalarType::Uint64},
  }};
  const auto* found = std::find_if(kNames.begin(), kNames.end(), [&](const auto& row) { return row.first == name; });
  if (found == kNames.end()) return std::nullopt;
  return found->second;
}

bool is_real(ScalarType type) { return type == ScalarType::Float32 || type == ScalarType::Float64; }

Result<PlyProperty> read_property(FieldCursor& fields) {
  PlyProperty property;
  std::string_view word = fields.take_word();
  if (word == "list") {
    property.count_type = type_named(fields.take_word());
    if (!property.count_type || is_real(*property.count_type))
      return fail(ErrorCode::InvalidInput, "a list needs an integer count type");
    word = fields.take_word();
  }
  const auto type = type_named(word);
  if (!type) return fail(ErrorCode::InvalidInput, fmt::format("unknown type '{}'", word.substr(0, 40)));
  property.type = *type;
  property.name = fields.take_word();
  if (property.name.empty()) return fail(ErrorCode::InvalidInput, "a property without a name");
  return property;
}

Result<PlyEncoding> read_encoding(FieldCursor& fields) {
  const std::string_view word = fields.take_word();
  if (word == "ascii") return PlyEncoding::Ascii;
  if (word == "binary_little_endian") return PlyEncoding::LittleEndian;
  if (word == "binary_big_endian") return PlyEncoding::BigEndian;
  return fail(ErrorCode::InvalidInput, fmt::format("unknown format '{}'", word.substr(0, 40)));
}

}  // namespace

bool PlyElement::has_list() const {
  return std::any_of(properties.begin(), properties.end(), [](const auto& p) { return p.count_type.has_value(); });
}

std::uint64_t PlyElement::least_bytes(PlyEncoding encoding) const {
  if (encoding == PlyEncoding::Ascii) return properties.empty() ? 1 : 2 * properties.size() - 1;
  std::uint64_t bytes = 0;
  for (const PlyProperty& p : properties) bytes += size_of(p.count_type.value_or(p.type));
  return bytes;
}

Result<PlyHeader> read_ply_header(std::string_view text) {
  TextCursor lines{text.substr(0, kMaxHeaderBytes)};
  PlyHeader header;
  bool has_format = false;
  if (lines.take_line() != "ply") return fail(ErrorCode::InvalidInput, "not a PLY file: the first line is not 'ply'");
  const auto bad = [&](std::string_view why) {
    return fail(ErrorCode::InvalidInput, fmt::format("PLY header, line {}: {}", lines.line_number(), why));
  };
  while (!lines.at_end()) {
    FieldCursor fields{lines.take_line()};
    const std::string_view key = fields.take_word();
    if (key == "end_header") {
      if (!has_format) return bad("no 'format' line");
      header.body_offset = text.substr(0, kMaxHeaderBytes).size() - lines.bytes_left();
      return header;
    }
    if (key == "format") {
      const auto encoding = read_encoding(fields);
      if (!encoding) return bad(encoding.error().what);
      header.encoding = *encoding;
      has_format = true;
    } else if (key == "element") {
      PlyElement element;
      element.name = fields.take_word();
      const auto count = fields.take<std::uint64_t>();
      if (!count) return bad("an element needs a name and a count of 0 or more");
      element.count = *count;
      header.elements.push_back(std::move(element));
    } else if (key == "property") {
      if (header.elements.empty()) return bad("a property before any element");
      auto property = read_property(fields);
      if (!property) return bad(property.error().what);
      header.elements.back().properties.push_back(std::move(*property));
    } else if (key == "obj_info") {
      const std::string_view what = fields.take_word();
      if (what == "num_cols") header.grid_columns = fields.take<std::uint32_t>().value_or(0);
      if (what == "num_rows") header.grid_rows = fields.take<std::uint32_t>().value_or(0);
    } else if (!key.empty() && key != "comment") {
      return bad(fmt::format("unknown keyword '{}'", key.substr(0, 40)));
    }
  }
  return fail(ErrorCode::InvalidInput, "PLY header without 'end_header': the file is truncated or not a PLY file");
}

}  // namespace telefab::scan
