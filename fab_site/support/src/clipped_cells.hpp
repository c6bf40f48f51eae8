// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <telefab/fab/region/region.hpp>
#include <vector>

namespace telefab::fab {

/// A plain plane vector, in units of the anchor distance.
struct Flat {
  double x = 0;
  double y = 0;
};

/// One Voronoi cell cut to the region.
struct ClippedCell {
  double area = 0;
  Flat centroid;
  Flat farthest;  ///< the vertex of the cut cell farthest from its site
  double farthest_distance = 0;
  Flat circle_centre;  ///< of the smallest circle around the cut cell
  double circle_radius = 0;
};

/// A region in units of the anchor distance, with its edges in buckets.
class CellRegion {
 public:
  CellRegion(const Region& region, double unit_mm);
  [[nodiscard]] bool inside(Flat p) const;
  [[nodiscard]] Flat least() const { return least_; }
  [[nodiscard]] Flat most() const { return most_; }
  [[nodiscard]] double area() const { return area_; }
  [[nodiscard]] Flat any_vertex() const { return edges_.front().a; }
  [[nodiscard]] bool empty() const { return edges_.empty(); }
  /// The last point inside on the way from `from` (inside) to `to`, a hair before the boundary.
  [[nodiscard]] Flat last_inside(Flat from, Flat to) const;
  /// The point of the boundary nearest to p.
  [[nodiscard]] Flat nearest_boundary(Flat p) const;
  /// A point strictly inside near a boundary point, found by probing; the point itself if all probes fail.
  [[nodiscard]] Flat nudged_inside(Flat p) const;
  /// Cuts every site's Voronoi cell (among all sites) to the region. Exact but for rounding. With a mask, only the
  /// cells marked in it.
  [[nodiscard]] std::vector<ClippedCell> cells(const std::vector<Flat>& sites,
                                               const std::vector<char>& wanted = {}) const;
  [[nodiscard]] Point2 to_mm(Flat p) const;
  [[nodiscard]] Flat from_mm(Point2 p) const;

 private:
  struct Edge {
    Flat a, b;
  };
  void gather(Flat low, Flat high, std::vector<std::uint32_t>& found, std::vector<std::uint32_t>& stamp,
              std::uint32_t mark) const;
  [[nodiscard]] ClippedCell cut(Flat site, const std::vector<Flat>& cell, const std::vector<std::uint32_t>& near) const;

  std::vector<Edge> edges_;
  std::vector<std::vector<std::uint32_t>> buckets_;
  Flat least_, most_;
  Point2 origin_mm_;
  double unit_mm_ = 1;
  double bucket_ = 0.5;
  int columns_ = 1;
  int rows_ = 1;
  double area_ = 0;
};

/// Neighbours of every site in the Delaunay triangulation; for few or collinear sites all the others.
[[nodiscard]] std::vector<std::vector<std::uint32_t>> delaunay_neighbours(const std::vector<Flat>& sites);

/// Smallest circle around the points (at least one).
[[nodiscard]] std::pair<Flat, double> smallest_circle(const std::vector<Flat>& points);

}  // namespace telefab::fab
