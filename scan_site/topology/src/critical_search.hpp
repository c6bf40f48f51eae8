// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <telefab/scan/topology/height_topology.hpp>

namespace telefab::scan::topology {

/// How widely to search.
struct SearchWidth {
  double least_nz = 0.866;          ///< samples with a smaller |n_z| start no search
  double cell_kernels = 0.75;       ///< one start a cell of this size
  double first_step_kernels = 1.5;  ///< a longer first step says: nothing level here
};

/// Starts of the search: of all samples with |n_z| above the least one, the best aligned one of every cell and sign of
/// n_z. Sorted by height, x, y.
[[nodiscard]] std::vector<Vec3> candidates(const ScalarField& field, std::span<const Vec3> samples,
                                           std::span<const Vec3> normals, const SearchWidth& width);

/// Constrained Newton on {g = 0, g_x = 0, g_y = 0} from every start; the same point found twice is one. Sorted by
/// height, x, y. Fails with Cancelled.
[[nodiscard]] Result<std::vector<CriticalPoint>> find_critical_points(const ScalarField& field,
                                                                      std::span<const Vec3> starts,
                                                                      const SearchWidth& width, std::stop_token stop);

/// Both lists as one; a point in both is one point. Sorted as above.
[[nodiscard]] std::vector<CriticalPoint> merged(const ScalarField& field, std::vector<CriticalPoint> points,
                                                std::span<const CriticalPoint> more);

}  // namespace telefab::scan::topology
