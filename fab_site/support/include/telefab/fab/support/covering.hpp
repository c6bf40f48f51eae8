// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <stop_token>
#include <telefab/base/quantity.hpp>
#include <telefab/fab/region/region.hpp>
#include <vector>

namespace telefab::fab {

struct CoveringOptions {
  Millimetres anchor_distance{3.0};  ///< > 0; every point of the region lies within this of an anchor
  int sweeps = 12;                   ///< 1 to 1000; relaxation sweeps per count tried; more is slower, not safer
  int removals = 24;                 ///< >= 0; anchors that may be tried for removal once the region is covered
  bool plain = false;  ///< the paper's method alone, to compare with: centroids, one anchor more at a time
  [[nodiscard]] Result<void> validate() const;
};

/// Anchors that hold a region.
struct Covering {
  std::vector<Point2> anchors;  ///< inside the region; sorted by y, then x
  double worst_mm = 0;          ///< largest distance of a point of the region to its nearest anchor
  int sweeps = 0;               ///< relaxation sweeps done
};

/// Fewest anchors we find such that every point of the region lies within the anchor distance of one, measured
/// exactly on the Voronoi cells clipped to the region (paper 4.2 (3)). Starts from the area's count on a triangular
/// lattice, relaxes by Lloyd sweeps (centroids, then centres of the cells' smallest circles), adds anchors where a
/// point is out of reach, then takes away what is not needed. Same input, same anchors.
/// Fails: InvalidInput (options), TooLarge (more than 200,000 anchors), Cancelled.
[[nodiscard]] Result<Covering> cover_region(const Region& region, const CoveringOptions& options, std::stop_token stop);

/// The pre-defined grid with the same guarantee, to compare with: a square grid of spacing sqrt(2) r, grid points
/// inside the region kept, and one more anchor for every grid cell that they leave uncovered somewhere.
[[nodiscard]] std::vector<Point2> grid_covering(const Region& region, Millimetres anchor_distance);

/// No covering by discs of radius r has fewer: area / (3 sqrt(3) / 2 r^2), rounded up, boundary effects left out.
[[nodiscard]] double covering_lower_bound(const Region& region, Millimetres anchor_distance);

}  // namespace telefab::fab
