// SPDX-License-Identifier: GPL-3.0-or-later
#include <fmt/format.h>
#include <array>
#include <cctype>
#include <cmath>

#include "readers.hpp"
#include "scalar_bytes.hpp"
#include "scan_builder.hpp"
#include "text_cursor.hpp"

// Files that hold a mesh: OFF, OBJ, STL. Only the vertices are taken; the way from scan to layers knows no mesh.
namespace telefab::scan {
namespace {

/// Three corners after one another are a facet.
void add_facets(ScanBuilder& builder) {
  for (std::uint64_t i = 0; builder.keeps_faces() && i + 2 < builder.size(); i += 3)
    builder.add_face(std::array<std::uint64_t, 3>{i, i + 1, i + 2});
}

/// Says once that numbers have a decimal comma, and are read so.
class CommaWatch {
 public:
  explicit CommaWatch(ScanBuilder& builder) : builder_{builder} {}
  void look_at(const FieldCursor& fields, std::string_view line) {
    if (is_warned_ || !fields.saw_decimal_comma()) return;
    is_warned_ = true;
    builder_.note(ScanRemark::DecimalComma,
                  fmt::format("numbers have a decimal comma: the first line that has is {}", line.substr(0, 60)));
  }

 private:
  ScanBuilder& builder_;
  bool is_warned_ = false;
};

std::optional<Vec3> take_vec(FieldCursor& fields) {
  Vec3 v;
  for (int axis = 0; axis < 3; ++axis) {
    const auto value = fields.take<double>();
    if (!value) return std::nullopt;
    v[axis] = *value;
  }
  return v;
}

constexpr std::size_t kStlHead = 84;
constexpr std::size_t kStlFacet = 50;

Result<ScanFile> read_binary_stl(std::span<const std::byte> bytes, const ReadOptions& options,
                                 const std::stop_token& stop) {
  const bool swapped = std::endian::native == std::endian::big;
  const auto facets = load<std::uint32_t>(bytes.data() + 80, swapped);
  ScanBuilder builder{ScanFormat::Stl, options};
  builder.points_are_corners();
  if (facets > (bytes.size() - kStlHead) / kStlFacet)
    return fail(ErrorCode::InvalidInput,
                fmt::format("STL: {} facets are claimed but {} bytes follow; the file is truncated", facets,
                            bytes.size() - kStlHead));
  if (auto room = builder.expect(std::uint64_t{facets} * 3, bytes.size() - kStlHead, kStlFacet / 3); !room)
    return tl::unexpected{room.error()};
  for (std::size_t f = 0; f < facets; ++f) {
    if (f % kStopEvery == 0 && stop.stop_requested()) return cancelled("reading points");
    const std::byte* corner = bytes.data() + kStlHead + f * kStlFacet + 12;
    for (int c = 0; c < 3; ++c, corner += 12)
      builder.add({load<float>(corner, swapped), load<float>(corner + 4, swapped), load<float>(corner + 8, swapped)});
  }
  add_facets(builder);
  return std::move(builder).finish();
}

Result<ScanFile> read_text_stl(std::span<const std::byte> bytes, const ReadOptions& options,
                               const std::stop_token& stop) {
  TextCursor lines{as_text(bytes)};
  ScanBuilder builder{ScanFormat::Stl, options};
  builder.points_are_corners();
  CommaWatch commas{builder};
  bool ended = false;
  for (std::size_t i = 0; !lines.at_end(); ++i) {
    if (i % kStopEvery == 0 && stop.stop_requested()) return cancelled("reading points");
    const std::string_view line = lines.take_line();
    FieldCursor fields{line, CommaRule::Decimal};
    const std::string_view word = fields.take_word();
    if (word == "endsolid") ended = true;
    if (word == "solid") ended = false;
    if (word != "vertex") continue;
    const auto point = take_vec(fields);
    if (!point || !fields.at_end())
      return fail(ErrorCode::InvalidInput,
                  fmt::format("STL line {}: a vertex needs 3 numbers{}", lines.line_number(), about_commas(line)));
    commas.look_at(fields, line);
    builder.add(*point);
  }
  if (!ended) return fail(ErrorCode::InvalidInput, "STL: no 'endsolid'; the file is truncated");
  add_facets(builder);
  return std::move(builder).finish();
}

}  // namespace

Result<ScanFile> read_off(std::span<const std::byte> bytes, const ReadOptions& options, const std::stop_token& stop) {
  TextCursor lines{as_text(bytes)};
  FieldCursor head{lines.take_full_line()};
  const std::string_view magic = head.take_word();
  if (!magic.ends_with("OFF") || magic.find_first_not_of("STCNOF") != std::string_view::npos)
    return fail(ErrorCode::InvalidInput,
                fmt::format("OFF kind '{}' is not read; OFF, COFF, NOFF and STOFF are", magic.substr(0, 20)));
  if (!head.at_end() && head.rest().starts_with("BINARY"))
    return fail(ErrorCode::InvalidInput, "binary OFF is not read; save it as text or as PLY");
  if (head.at_end()) head = FieldCursor{lines.take_full_line()};
  const auto vertices = head.take<std::uint64_t>();
  const auto faces = head.take<std::uint64_t>();
  if (!vertices || !faces)
    return fail(ErrorCode::InvalidInput,
                fmt::format("OFF line {}: the numbers of vertices and faces are expected", lines.line_number()));
  const bool has_normals = magic.find('N') != std::string_view::npos;
  ScanBuilder builder{ScanFormat::Off, options};
  if (*faces > 0) builder.points_are_corners();
  CommaWatch commas{builder};
  if (auto room = builder.expect(*vertices, lines.bytes_left() + 1, has_normals ? 12 : 6); !room)
    return tl::unexpected{room.error()};
  for (std::uint64_t i = 0; i < *vertices; ++i) {
    if (i % kStopEvery == 0 && stop.stop_requested()) return cancelled("reading points");
    const std::string_view line = lines.take_full_line();
    if (line.empty())
      return fail(ErrorCode::InvalidInput,
                  fmt::format("the file ends after {} of {} vertices: it is truncated", i, *vertices));
    FieldCursor fields{line, CommaRule::Decimal};
    const auto point = take_vec(fields);
    const auto normal = point && has_normals ? take_vec(fields) : std::optional{Vec3{Vec3::Zero()}};
    if (!point || !normal)
      return fail(ErrorCode::InvalidInput, fmt::format("OFF line {}: vertex {} needs {} numbers{}", lines.line_number(),
                                                       i, has_normals ? 6 : 3, about_commas(line)));
    commas.look_at(fields, line);
    builder.add(*point);
    if (has_normals) builder.add_normal(*normal);
  }
  std::vector<std::uint64_t> corners;
  for (std::uint64_t i = 0; i < *faces; ++i) {
    const std::string_view line = lines.take_full_line();
    if (line.empty())
      return fail(ErrorCode::InvalidInput,
                  fmt::format("the file ends after {} of {} faces: it is truncated", i, *faces));
    if (!builder.keeps_faces()) continue;
    FieldCursor fields{line};
    corners.clear();
    const auto count = fields.take<std::uint64_t>();
    for (std::uint64_t k = 0; count && k < *count; ++k) {
      const auto corner = fields.take<std::uint64_t>();
      if (!corner)
        return fail(ErrorCode::InvalidInput, fmt::format("OFF line {}: face {} is cut short", lines.line_number(), i));
      corners.push_back(*corner);
    }
    builder.add_face(corners);
  }
  return std::move(builder).finish();
}

namespace {

/// The corner "7", "7/2" or "-1//3" of a face as an index of the vertices so far; nothing if it is none.
std::optional<std::uint64_t> obj_corner(std::string_view corner, std::size_t vertices) {
  FieldCursor number{corner.substr(0, corner.find('/'))};
  const auto index = number.take<std::int64_t>();
  if (!index || *index == 0) return std::nullopt;
  const std::int64_t at = *index > 0 ? *index - 1 : static_cast<std::int64_t>(vertices) + *index;
  return at >= 0 ? std::optional{static_cast<std::uint64_t>(at)} : std::nullopt;
}

}  // namespace

Result<ScanFile> read_obj(std::span<const std::byte> bytes, const ReadOptions& options, const std::stop_token& stop) {
  TextCursor lines{as_text(bytes)};
  ScanBuilder builder{ScanFormat::Obj, options};
  if (builder.keeps_faces()) builder.points_are_named();
  CommaWatch commas{builder};
  std::size_t normals = 0;
  bool normals_by_vertex = true;  // until a face says that vertex i has another normal than i
  std::vector<std::uint64_t> corners;
  for (std::size_t i = 0; !lines.at_end(); ++i) {
    if (i % kStopEvery == 0 && stop.stop_requested()) return cancelled("reading points");
    const std::string_view line = lines.take_line();
    FieldCursor fields{line, CommaRule::Decimal};
    const std::string_view key = fields.take_word();
    if (key == "v" || key == "vn") {
      const auto v = take_vec(fields);
      if (!v)
        return fail(ErrorCode::InvalidInput,
                    fmt::format("OBJ line {}: '{}' needs 3 numbers{}", lines.line_number(), key, about_commas(line)));
      commas.look_at(fields, line);
      if (key == "v") {
        builder.add(*v);
      } else {
        builder.add_normal(*v);
        ++normals;
      }
    } else if (key == "f") {
      builder.points_are_corners();
      if (!builder.keeps_faces() && (normals == 0 || !normals_by_vertex)) continue;
      corners.clear();
      while (!fields.at_end()) {
        const std::string_view corner = fields.take_word();
        const std::size_t slash = corner.rfind('/');
        normals_by_vertex &=
            slash != std::string_view::npos && corner.substr(0, corner.find('/')) == corner.substr(slash + 1);
        const auto index = obj_corner(corner, builder.size());
        if (!index && builder.keeps_faces())
          return fail(ErrorCode::InvalidInput,
                      fmt::format("OBJ line {}: '{}' names no vertex", lines.line_number(), corner.substr(0, 40)));
        corners.push_back(index.value_or(0));
      }
      builder.add_face(corners);
    }
  }
  if (normals != builder.size() || !normals_by_vertex) builder.forget_normals();
  return std::move(builder).finish();
}

bool looks_like_stl(std::span<const std::byte> bytes) {
  const std::string_view text = as_text(bytes);
  if (bytes.size() >= kStlHead) {
    const auto facets = load<std::uint32_t>(bytes.data() + 80, std::endian::native == std::endian::big);
    if (bytes.size() - kStlHead == std::uint64_t{facets} * kStlFacet) return true;
  }
  return text.starts_with("solid") && text.substr(0, 4096).find("facet") != std::string_view::npos;
}

Result<ScanFile> read_stl(std::span<const std::byte> bytes, const ReadOptions& options, const std::stop_token& stop) {
  const std::string_view text = as_text(bytes);
  if (text.starts_with("solid") && text.substr(0, 4096).find("facet") != std::string_view::npos)
    return read_text_stl(bytes, options, stop);
  if (bytes.size() < kStlHead)
    return fail(
        ErrorCode::InvalidInput,
        fmt::format("STL: {} bytes are less than its head of {}; the file is truncated", bytes.size(), kStlHead));
  return read_binary_stl(bytes, options, stop);
}

}  // namespace telefab::scan
