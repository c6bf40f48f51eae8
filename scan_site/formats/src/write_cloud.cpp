// SPDX-License-Identifier: GPL-3.0-or-later
#include <telefab/scan/formats/write_cloud.hpp>

#include <fmt/format.h>
#include <algorithm>
#include <bit>
#include <cstring>
#include <string>

#include "ply_header.hpp"

namespace telefab::scan {
namespace {

template <class T>
void put(std::vector<std::byte>& out, T value) {
  std::array<std::byte, sizeof(T)> raw = std::bit_cast<std::array<std::byte, sizeof(T)>>(value);
  if constexpr (std::endian::native == std::endian::big) std::reverse(raw.begin(), raw.end());
  out.insert(out.end(), raw.begin(), raw.end());
}

void put(std::vector<std::byte>& out, const Eigen::Vector3f& v) {
  for (int axis = 0; axis < 3; ++axis) put(out, v[axis]);
}

std::string one_line(std::string_view text) {
  std::string line{text};
  std::replace_if(
      line.begin(), line.end(), [](char c) { return c == '\n' || c == '\r'; }, ' ');
  return line;
}

std::vector<std::byte> started_with(const std::string& head, std::size_t more) {
  std::vector<std::byte> out;
  out.reserve(head.size() + more);
  const auto text = std::as_bytes(std::span{head});
  out.insert(out.end(), text.begin(), text.end());
  return out;
}

}  // namespace

std::vector<std::byte> write_ply(const PointCloud& cloud, std::span<const PointColour> colours,
                                 std::string_view comment) {
  const bool wide = !cloud.origin.isZero(0);
  const bool coloured = colours.size() == cloud.size() && !colours.empty();
  std::string head = fmt::format("ply\nformat binary_little_endian 1.0\ncomment {}\nelement vertex {}\n",
                                 one_line(comment), cloud.size());
  for (const char axis : {'x', 'y', 'z'}) head += fmt::format("property {} {}\n", wide ? "double" : "float", axis);
  if (cloud.has_normals()) head += "property float nx\nproperty float ny\nproperty float nz\n";
  if (!cloud.confidence.empty()) head += "property float confidence\n";
  if (!cloud.sheets_apart.empty()) head += fmt::format("property float {}\n", kSheetsApartProperty);
  if (coloured) head += "property uchar red\nproperty uchar green\nproperty uchar blue\n";
  head += "end_header\n";
  std::vector<std::byte> out = started_with(head, cloud.size() * 47);
  for (std::size_t i = 0; i < cloud.size(); ++i) {
    if (wide)
      for (int axis = 0; axis < 3; ++axis) put(out, cloud.origin[axis] + static_cast<double>(cloud.points[i][axis]));
    else
      put(out, cloud.points[i]);
    if (cloud.has_normals()) put(out, cloud.normals[i]);
    if (!cloud.confidence.empty()) put(out, cloud.confidence[i]);
    if (!cloud.sheets_apart.empty()) put(out, cloud.sheets_apart[i]);
    if (coloured)
      for (const std::uint8_t c : colours[i]) put(out, c);
  }
  return out;
}

std::vector<std::byte> write_range_ply(std::span<const Eigen::Vector3f> points, const RangeView& view,
                                       std::string_view comment) {
  const std::string head = fmt::format(
      "ply\nformat binary_little_endian 1.0\ncomment {}\nobj_info num_cols {}\nobj_info num_rows {}\nelement vertex "
      "{}\nproperty float x\nproperty "
      "float y\nproperty float z\nelement range_grid {}\nproperty list uchar int vertex_indices\nend_header\n",
      one_line(comment), view.columns, view.rows, points.size(), view.point_at.size());
  std::vector<std::byte> out = started_with(head, points.size() * 16 + view.point_at.size());
  for (const Eigen::Vector3f& p : points) put(out, p);
  for (const std::int32_t i : view.point_at) {
    put(out, static_cast<std::uint8_t>(i >= 0 ? 1 : 0));
    if (i >= 0) put(out, i);
  }
  return out;
}

}  // namespace telefab::scan
