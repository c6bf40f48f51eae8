// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <optional>

#include "curve_coding.hpp"

// The encoder's search. Only its result is sent, so only its result must be right: every fit comes with the proof that
// the decoded ring and the given one are nowhere farther apart than the tolerance, both ways.
namespace telefab::codec {

struct FitRule {
  double tolerance = 7;  ///< lattice steps
  CurveSteps steps;
  GridPoint most;
};

struct RingFit {
  RingPlan plan;
  std::vector<GridPoint> ring;  ///< as every decoder will have it
  double cost_bits = 0;
  double error = 0;  ///< lattice steps; an upper bound of the distance, both ways
};

/// The reference moved onto the target: the cheapest of all ways to keep, move, drop and add vertices within the
/// tolerance, by dynamic programming over the reference's vertices. Nothing where there is none.
[[nodiscard]] std::optional<RingFit> fit_motion(const MovingRing& reference, std::span<const Place> target,
                                                const CurveModels& models, const FitRule& rule);

/// The target as intra ring, on the coarser lattice: by longest chords within the tolerance, or by few corners and what
/// lies over their edges, whichever is cheaper; with `all` every vertex is kept. Nothing where no area of the same sign
/// is left.
[[nodiscard]] std::optional<RingFit> fit_intra(std::span<const Place> target, const CurveModels& models,
                                               const FitRule& rule, bool all);

/// Twice the area, in square lattice steps; exact.
[[nodiscard]] double twice_area(std::span<const GridPoint> ring);
[[nodiscard]] double twice_area(std::span<const Place> ring);

}  // namespace telefab::codec
