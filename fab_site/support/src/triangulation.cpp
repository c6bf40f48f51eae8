// SPDX-License-Identifier: GPL-3.0-or-later
#include "triangulation.hpp"

#include <CGAL/Constrained_Delaunay_triangulation_2.h>
#include <CGAL/Exact_predicates_inexact_constructions_kernel.h>
#include <CGAL/Triangulation_face_base_with_info_2.h>
#include <CGAL/Triangulation_vertex_base_with_info_2.h>

#include <deque>
#include <optional>

namespace telefab::fab {
namespace {

/// Of a face: how many edges of the region lie between it and the far outside; unset: not yet reached.
using Depth = std::optional<int>;
using Kernel = CGAL::Exact_predicates_inexact_constructions_kernel;
using Vertex = CGAL::Triangulation_vertex_base_with_info_2<std::uint32_t, Kernel>;
using Face =
    CGAL::Constrained_triangulation_face_base_2<Kernel, CGAL::Triangulation_face_base_with_info_2<Depth, Kernel>>;
// Rings of a region touch at most in vertices, and lie on a grid.
using Triangles = CGAL::Constrained_Delaunay_triangulation_2<Kernel, CGAL::Triangulation_data_structure_2<Vertex, Face>,
                                                             CGAL::Exact_predicates_tag>;

}  // namespace

std::vector<std::array<std::uint32_t, 3>> triangulated(const Region& region) {
  Triangles triangles;
  std::uint32_t next = 0;
  for (const GridRing& ring : region.rings()) {
    std::vector<Triangles::Vertex_handle> handles;
    for (const GridPoint& g : ring) {
      const std::size_t before = triangles.number_of_vertices();
      const auto vertex = triangles.insert({static_cast<double>(g.x), static_cast<double>(g.y)});
      if (triangles.number_of_vertices() != before) vertex->info() = next;
      handles.push_back(vertex);
      ++next;
    }
    for (std::size_t i = 0; i < handles.size(); ++i)
      if (const auto to = handles[(i + 1) % handles.size()]; to != handles[i])
        triangles.insert_constraint(handles[i], to);
  }
  std::vector<std::array<std::uint32_t, 3>> out;
  if (triangles.dimension() < 2) return out;
  std::deque<Triangles::Face_handle> reached{triangles.infinite_face()};
  triangles.infinite_face()->info() = 0;
  while (!reached.empty()) {
    const auto face = reached.front();
    reached.pop_front();
    for (int i = 0; i < 3; ++i) {
      const auto other = face->neighbor(i);
      if (other->info()) continue;
      const bool crosses = face->is_constrained(i);
      other->info() = *face->info() + crosses;
      // Breadth first by depth, so that every face gets the least.
      if (crosses)
        reached.push_back(other);
      else
        reached.push_front(other);
    }
  }
  for (auto face = triangles.finite_faces_begin(); face != triangles.finite_faces_end(); ++face)
    if (face->info() && *face->info() % 2 == 1)
      out.push_back({face->vertex(0)->info(), face->vertex(1)->info(), face->vertex(2)->info()});
  return out;
}

}  // namespace telefab::fab
