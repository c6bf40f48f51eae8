// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <telefab/geometry/layer.hpp>

#include "curve_fit.hpp"

namespace telefab::codec {

/// How a layer is to be written, found but not yet written.
struct LayerFit {
  std::vector<RingPlan> plans;
  std::vector<std::vector<GridPoint>> rings;  ///< as decoders will have them, in the order of the plans
  std::vector<std::size_t> lost;              ///< contours without area on the lattice
  double error = 0;                           ///< lattice steps
};

/// Every contour as the ring below it moved, where that is smaller, or intra. With `exact` all intra with all vertices.
[[nodiscard]] LayerFit fit_layer(const Layer& layer, const Grid& grid, const CurveState& state, const FitRule& rule,
                                 bool exact);

/// The rings in canonical order (sorted_canonically), on the lattice.
[[nodiscard]] std::vector<std::vector<GridPoint>> canonical_rings(std::vector<std::vector<GridPoint>> rings);
[[nodiscard]] std::vector<std::vector<GridPoint>> positions_of(const std::vector<MovingRing>& rings);

}  // namespace telefab::codec
