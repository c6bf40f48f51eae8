// SPDX-License-Identifier: GPL-3.0-or-later
#include <CGAL/Delaunay_triangulation_2.h>
#include <CGAL/Exact_predicates_inexact_constructions_kernel.h>
#include <CGAL/Triangulation_vertex_base_with_info_2.h>

#include <algorithm>
#include <limits>

#include "clipped_cells.hpp"

namespace telefab::fab {
namespace {

using Kernel = CGAL::Exact_predicates_inexact_constructions_kernel;
using Vertex = CGAL::Triangulation_vertex_base_with_info_2<std::uint32_t, Kernel>;
using Triangles = CGAL::Delaunay_triangulation_2<Kernel, CGAL::Triangulation_data_structure_2<Vertex>>;
constexpr std::size_t kFew = 10;

std::vector<std::vector<std::uint32_t>> everybody(std::size_t count) {
  std::vector<std::vector<std::uint32_t>> all(count);
  for (std::uint32_t i = 0; i < count; ++i)
    for (std::uint32_t j = 0; j < count; ++j)
      if (i != j) all[i].push_back(j);
  return all;
}

}  // namespace

std::vector<std::vector<std::uint32_t>> delaunay_neighbours(const std::vector<Flat>& sites) {
  if (sites.size() <= kFew) return everybody(sites.size());
  Triangles triangles;
  Triangles::Face_handle hint;
  constexpr std::uint32_t kUnset = std::numeric_limits<std::uint32_t>::max();
  std::vector<std::uint32_t> twin(sites.size());
  for (std::uint32_t i = 0; i < sites.size(); ++i) {
    const std::size_t before = triangles.number_of_vertices();
    const auto vertex = triangles.insert({sites[i].x, sites[i].y}, hint);
    if (triangles.number_of_vertices() != before) vertex->info() = i;
    twin[i] = vertex->info();
    hint = vertex->face();
  }
  std::vector<std::vector<std::uint32_t>> near(sites.size());
  if (triangles.dimension() < 2) return everybody(sites.size());
  for (auto v = triangles.finite_vertices_begin(); v != triangles.finite_vertices_end(); ++v) {
    auto around = triangles.incident_vertices(v);
    const auto first = around;
    do {
      if (!triangles.is_infinite(around) && around->info() != kUnset) near[v->info()].push_back(around->info());
    } while (++around != first);
    std::sort(near[v->info()].begin(), near[v->info()].end());
  }
  // A site on top of another has the other's cell.
  for (std::uint32_t i = 0; i < sites.size(); ++i)
    if (twin[i] != i) near[i] = near[twin[i]];
  return near;
}

}  // namespace telefab::fab
