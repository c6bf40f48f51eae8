// SPDX-License-Identifier: GPL-3.0-or-later
#include <fmt/format.h>
#include <tbb/parallel_for.h>

#include <bit>
#include <cmath>
#include <numbers>
#include <telefab/fab/support/structure_mesh.hpp>

#include "triangulation.hpp"

namespace telefab::fab {
namespace {

static_assert(std::endian::native == std::endian::little, "the PLY is written as it lies in memory");
using Rgb = std::array<std::uint8_t, 3>;
constexpr Rgb kPart{198, 204, 214}, kSupport{240, 150, 40};

std::uint32_t add_vertex(TriangleMesh& mesh, double x, double y, double z) {
  mesh.vertices.push_back({static_cast<float>(x), static_cast<float>(y), static_cast<float>(z)});
  return static_cast<std::uint32_t>(mesh.vertices.size() - 1);
}

void add_quad(TriangleMesh& mesh, std::uint32_t a, std::uint32_t b, std::uint32_t c, std::uint32_t d) {
  mesh.triangles.push_back({a, b, c});
  mesh.triangles.push_back({a, c, d});
}

/// A closed solid between two level rings of the same count.
void add_solid(TriangleMesh& mesh, const std::vector<Point3>& low, const std::vector<Point3>& high) {
  std::vector<std::uint32_t> a, b;
  for (const Point3& p : low) a.push_back(add_vertex(mesh, p.x_mm, p.y_mm, p.z_mm));
  for (const Point3& p : high) b.push_back(add_vertex(mesh, p.x_mm, p.y_mm, p.z_mm));
  for (std::size_t i = 0; i < a.size(); ++i) {
    const std::size_t j = (i + 1) % a.size();
    add_quad(mesh, a[i], a[j], b[j], b[i]);
    if (i > 0 && i + 1 < a.size()) {
      mesh.triangles.push_back({a[0], a[j], a[i]});
      mesh.triangles.push_back({b[0], b[i], b[j]});
    }
  }
}

std::vector<Point3> level_disc(Point3 c, double r) {
  std::vector<Point3> ring;
  for (int i = 0; i < 12; ++i) {
    const double a = 2 * std::numbers::pi * i / 12;
    ring.push_back({c.x_mm + r * std::cos(a), c.y_mm + r * std::sin(a), c.z_mm});
  }
  return ring;
}

std::vector<Point3> level_plate(const Plate& plate, double z_mm) {
  std::vector<Point3> ring;
  const int chords = plate.corners.size() > 2 ? 4 : plate.corners.size() == 2 ? 7 : 12;
  for (const Point2 p : ring_around(plate.corners, std::max(1e-3, plate.radius_at(z_mm)), chords))
    ring.push_back({p.x_mm, p.y_mm, z_mm});
  return ring;
}

/// One layer as a closed slab.
TriangleMesh slab_of(const Region& region, double z0, double z1) {
  TriangleMesh mesh;
  std::uint32_t count = 0;
  for (const GridRing& ring : region.rings()) count += static_cast<std::uint32_t>(ring.size());
  for (const double z : {z0, z1})
    for (const GridRing& ring : region.rings())
      for (const GridPoint& g : ring) add_vertex(mesh, to_mm(g).x_mm, to_mm(g).y_mm, z);
  std::uint32_t first = 0;
  for (const GridRing& ring : region.rings()) {
    const auto n = static_cast<std::uint32_t>(ring.size());
    for (std::uint32_t i = 0; i < n; ++i) {
      const std::uint32_t a = first + i, b = first + (i + 1) % n;
      add_quad(mesh, a, b, b + count, a + count);
    }
    first += n;
  }
  for (const auto& t : triangulated(region)) {
    mesh.triangles.push_back({t[0] + count, t[1] + count, t[2] + count});
    mesh.triangles.push_back({t[0], t[2], t[1]});
  }
  return mesh;
}

void append(std::string& to, const void* from, std::size_t bytes) { to.append(static_cast<const char*>(from), bytes); }

}  // namespace

StructureMesh structure_mesh(std::span<const Layer> part, const SupportPlan& plan, double thickness_mm,
                             Millimetres tolerance) {
  StructureMesh mesh;
  for (const SupportElement& s : plan.structure().elements)
    add_solid(mesh.supports, level_disc(s.bottom, s.bottom_radius_mm), level_disc(s.top, s.top_radius_mm));
  for (const Plate& p : plan.structure().plates) {
    add_solid(mesh.supports, level_plate(p, 0), level_plate(p, p.height_mm / 2));
    add_solid(mesh.supports, level_plate(p, p.height_mm / 2), level_plate(p, p.height_mm));
  }
  std::vector<TriangleMesh> slabs(part.size());
  tbb::parallel_for(std::size_t{0}, part.size(), [&](std::size_t k) {
    const auto region = Region::from_contours(part[k].contours);
    if (!region) return;
    const double z0 = (part[k].index.count() + plan.elevation_layers()) * thickness_mm;
    slabs[k] = slab_of(simplified(*region, tolerance), z0, z0 + thickness_mm);
  });
  for (const TriangleMesh& slab : slabs) {
    const auto first = static_cast<std::uint32_t>(mesh.part.vertices.size());
    mesh.part.vertices.insert(mesh.part.vertices.end(), slab.vertices.begin(), slab.vertices.end());
    for (const auto& t : slab.triangles) mesh.part.triangles.push_back({t[0] + first, t[1] + first, t[2] + first});
  }
  return mesh;
}

std::string to_ply(const StructureMesh& mesh) {
  std::string text = fmt::format(
      "ply\nformat binary_little_endian 1.0\ncomment part grey, supports orange, millimetres\n"
      "element vertex {}\nproperty float x\nproperty float y\nproperty float z\nproperty uchar red\n"
      "property uchar green\nproperty uchar blue\nelement face {}\n"
      "property list uchar int vertex_indices\nend_header\n",
      mesh.supports.vertices.size() + mesh.part.vertices.size(),
      mesh.supports.triangles.size() + mesh.part.triangles.size());
  for (const auto& [body, colour] : {std::pair{&mesh.supports, kSupport}, {&mesh.part, kPart}})
    for (const auto& v : body->vertices) {
      append(text, v.data(), sizeof v);
      append(text, colour.data(), colour.size());
    }
  const auto behind = static_cast<std::uint32_t>(mesh.supports.vertices.size());
  for (const auto& [body, first] : {std::pair{&mesh.supports, 0U}, {&mesh.part, behind}})
    for (const auto& t : body->triangles) {
      const std::array<std::uint32_t, 3> abc{t[0] + first, t[1] + first, t[2] + first};
      text += '\3';
      append(text, abc.data(), sizeof abc);
    }
  return text;
}

}  // namespace telefab::fab
