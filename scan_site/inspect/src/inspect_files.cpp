// SPDX-License-Identifier: GPL-3.0-or-later
#include <fmt/format.h>

#include <bit>
#include <cmath>
#include <iterator>
#include <telefab/scan/inspect/inspect_scan.hpp>

#include "inspect_colours.hpp"

namespace telefab::scan {
namespace {

void append_float(std::string& out, double value) {
  const auto bits = std::bit_cast<std::uint32_t>(static_cast<float>(value));
  for (int shift = 0; shift < 32; shift += 8) out.push_back(static_cast<char>(bits >> shift & 0xffu));
}

void append_vertex(std::string& out, const Vec3& p, const Vec3& n, Colour c) {
  for (int axis = 0; axis < 3; ++axis) append_float(out, p[axis]);
  for (int axis = 0; axis < 3; ++axis) append_float(out, n[axis]);
  for (const std::uint8_t v : {c.red, c.green, c.blue}) out.push_back(static_cast<char>(v));
}

}  // namespace

std::string to_ply(const Inspection& inspection) {
  const HeightTopology& t = inspection.topology;
  std::string body;
  std::size_t count = 0;
  const auto add = [&](const Vec3& p, const Vec3& n, Colour c) {
    append_vertex(body, p, n, c);
    ++count;
  };
  for (std::size_t i = 0; i < inspection.samples.size(); ++i)
    add(inspection.samples[i], inspection.normals[i], {200, 200, 200});
  for (const IntegralLine& line : t.integral_lines())
    for (const Vec3& p : line.path_mm) add(p, Vec3::Zero(), line.ascending ? kAscending : kDescending);
  for (const ReebArc& arc : t.arcs())
    for (const Vec3& p : arc.path_mm) add(p, Vec3::Zero(), arc.hole ? kHoleArc : kOuterArc);
  for (const CriticalPoint& c : t.critical_points())
    add(c.position_mm, (c.normal_up ? 1 : -1) * Vec3::UnitZ(), colour_of(c.kind));
  return fmt::format(
             "ply\nformat binary_little_endian 1.0\ncomment telefab: scan, integral lines, Reeb arcs, critical points; "
             "millimetres, build frame\nelement vertex {}\nproperty float x\nproperty float y\nproperty float z\n"
             "property float nx\nproperty float ny\nproperty float nz\nproperty uchar red\nproperty uchar green\n"
             "property uchar blue\nend_header\n",
             count) +
         body;
}

std::string to_vtp(const Inspection& inspection) {
  const HeightTopology& t = inspection.topology;
  std::string points, lines, offsets, what, component;
  std::size_t count = 0, end = 0;
  const auto add_point = [&](const Vec3& p) {
    fmt::format_to(std::back_inserter(points), "{:.9g} {:.9g} {:.9g}\n", p.x(), p.y(), p.z());
    return count++;
  };
  std::string vertices, vertex_offsets;
  // Cells come in VTK's order, vertices before lines, and the cell arrays with them.
  std::string persistence;
  std::vector<std::size_t> component_of(t.critical_points().size(), 0);
  for (const ReebNode& n : t.nodes())
    for (const std::size_t c : n.critical_points) component_of[c] = n.component;
  for (std::size_t i = 0; i < t.critical_points().size(); ++i) {
    const CriticalPoint& c = t.critical_points()[i];
    fmt::format_to(std::back_inserter(vertices), "{} ", add_point(c.position_mm));
    fmt::format_to(std::back_inserter(vertex_offsets), "{} ", i + 1);
    fmt::format_to(std::back_inserter(what), "{} ", static_cast<int>(c.kind));
    fmt::format_to(std::back_inserter(component), "{} ", component_of[i]);
    fmt::format_to(std::back_inserter(persistence), "{:.9g} ", std::isfinite(c.persistence_mm) ? c.persistence_mm : -1);
  }
  std::size_t line_count = 0;
  const auto add_line = [&](std::span<const Vec3> path, int kind, std::size_t part) {
    if (path.size() < 2) return;
    for (const Vec3& p : path) fmt::format_to(std::back_inserter(lines), "{} ", add_point(p));
    end += path.size();
    ++line_count;
    fmt::format_to(std::back_inserter(offsets), "{} ", end);
    fmt::format_to(std::back_inserter(what), "{} ", kind);
    fmt::format_to(std::back_inserter(component), "{} ", part);
    persistence += "-1 ";
  };
  for (const IntegralLine& line : t.integral_lines())
    add_line(line.path_mm, line.ascending ? 11 : 12, component_of[line.saddle]);
  for (const ReebArc& arc : t.arcs()) add_line(arc.path_mm, arc.hole ? 22 : 21, t.nodes()[arc.lower].component);
  const auto array = [](std::string_view type, std::string_view name, const std::string& values) {
    return fmt::format("<DataArray type=\"{}\" Name=\"{}\" format=\"ascii\">\n{}\n</DataArray>\n", type, name, values);
  };
  return fmt::format(
      "<?xml version=\"1.0\"?>\n<VTKFile type=\"PolyData\" version=\"0.1\" byte_order=\"LittleEndian\">\n"
      "<!-- what: 1 minimum, 2 bottom saddle, 3 top saddle, 4 maximum, 11 ascending, 12 descending line, 21 outer, 22 "
      "hole arc -->\n"
      "<PolyData>\n<Piece NumberOfPoints=\"{}\" NumberOfVerts=\"{}\" NumberOfLines=\"{}\" NumberOfStrips=\"0\" "
      "NumberOfPolys=\"0\">\n<CellData Scalars=\"what\">\n{}{}{}</CellData>\n<Points>\n<DataArray type=\"Float32\" "
      "NumberOfComponents=\"3\" format=\"ascii\">\n{}</DataArray>\n</Points>\n<Verts>\n{}{}</Verts>\n<Lines>\n{}{}"
      "</Lines>\n</Piece>\n</PolyData>\n</VTKFile>\n",
      count, t.critical_points().size(), line_count, array("Int32", "what", what),
      array("Int32", "component", component), array("Float32", "persistence_mm", persistence), points,
      array("Int64", "connectivity", vertices), array("Int64", "offsets", vertex_offsets),
      array("Int64", "connectivity", lines), array("Int64", "offsets", offsets));
}

}  // namespace telefab::scan
