// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <telefab/scan/topology/height_topology.hpp>

#include "reeb_nodes.hpp"

namespace telefab::scan::topology {

/// The enhanced Reeb graph over critical points and plateaus (which it reads and completes): fills lines, nodes,
/// arcs, components, inconsistencies and persistences of `parts`. Critical heights within `run_kernels` * h are not
/// ordered. `memory` is of the same critical points and plateaus, or empty. Fails with Cancelled.
[[nodiscard]] Result<void> build_reeb_graph(const ScalarField& field, std::span<const Vec3> samples,
                                            std::span<const Vec3> normals, HeightTopology::Parts& parts,
                                            double run_kernels, NodeMemory& memory, std::stop_token stop);

}  // namespace telefab::scan::topology
