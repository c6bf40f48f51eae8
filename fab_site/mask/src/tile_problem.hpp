// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <cstdint>
#include <vector>

#include "spot_weights.hpp"

namespace telefab::fab {

/// One square of pixels whose doses are sought: core and halo. Doses are shares of a normal white dose.
struct TileProblem {
  struct Spot {
    std::int32_t offset;  ///< of its window's first pixel
    std::uint32_t node_x;
    std::uint32_t node_y;
    float weight;       ///< over the squared slope of a straight edge
    float inside_core;  ///< its length if it counts in the figures, else 0
  };

  int side = 0;       ///< multiple of 8; row stride of all arrays
  float target = 0;   ///< dose on the contour
  float regular = 0;  ///< pull towards the reference
  std::vector<float> least, most, reference;
  std::vector<Spot> spots;
  const SpotWeights* weights = nullptr;

  /// Columns of each row that the spots see, in steps of 8; last is one behind. Bounds and reference count there alone.
  std::vector<std::int32_t> first, last;

  // What the solver works on.
  std::vector<float> dose;  ///< the solution
  std::vector<float> ahead, slope, steepness;

  void resize(int side_px);
  void clear_spots();
  void add(const Spot& spot);
  /// Whether a spot sees that pixel.
  [[nodiscard]] bool touched(std::size_t pixel) const { return steepness[pixel] != regular; }
};

/// Minimises sum of weight * (dose at spot - target)^2 + regular * sum of (dose - reference)^2 within the bounds by
/// projected steps under a diagonal that majorises the curvature, with Nesterov's momentum. Returns the weighted sum
/// of squared differences on the core's spots, in shares of a white dose.
double solve_tile(TileProblem& problem, int iterations);

// The same arithmetic, lane by lane, in two instruction sets.
double solve_tile_baseline(TileProblem& problem, int iterations);
double solve_tile_avx2(TileProblem& problem, int iterations);

}  // namespace telefab::fab
