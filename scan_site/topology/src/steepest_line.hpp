// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <telefab/scan/topology/height_topology.hpp>
#include <unordered_map>

#include "cells.hpp"

namespace telefab::scan::topology {

/// Finds the critical point beside a point of the surface, on the same side of the solid.
class CriticalIndex {
 public:
  CriticalIndex(const ScalarField& field, std::span<const CriticalPoint> points);
  /// The nearest one within `reach_kernels`, if `wanted` says so; ties go to the lower index.
  template <class Wanted>
  [[nodiscard]] std::optional<std::size_t> nearest(const Vec3& p, bool normal_up, double reach_mm,
                                                   Wanted&& wanted) const {
    std::optional<std::size_t> best;
    double least = reach_mm;
    around(cell_of(p, cell_mm_), [&](std::uint64_t key) {
      const auto at = cells_.find(key);
      if (at == cells_.end()) return;
      for (const std::size_t i : at->second) {
        const double d = (points_[i].position_mm - p).norm();
        if (d < least && points_[i].normal_up == normal_up && wanted(points_[i])) {
          least = d;
          best = i;
        }
      }
    });
    return best;
  }
  [[nodiscard]] const CriticalPoint& operator[](std::size_t i) const { return points_[i]; }

 private:
  std::span<const CriticalPoint> points_;
  double cell_mm_ = 1;
  std::unordered_map<std::uint64_t, std::vector<std::size_t>> cells_;
};

struct SteepestLine {
  std::vector<Vec3> path_mm;       ///< strictly monotone in z
  std::optional<std::size_t> end;  ///< critical point reached, also the path's last point
};

/// The line of steepest ascent (or descent) over the surface, from a point on it to the critical point where it
/// ends, or to the first point at or beyond `until_z_mm`. `leaving` is not accepted as an end.
[[nodiscard]] SteepestLine follow_steepest(const ScalarField& field, FieldCursor& cursor, const CriticalIndex& index,
                                           const Vec3& start, bool ascending, std::optional<std::size_t> leaving,
                                           std::optional<double> until_z_mm = std::nullopt);

}  // namespace telefab::scan::topology
