// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <span>
#include <vector>

#include "grid.hpp"

// How a contour moves from one layer to the next. Both sites run this code, so it is integers, and + - * / sqrt of
// doubles without contraction, which IEEE 754 defines to the bit.
namespace telefab::codec {

/// A vertex of a coded ring and what is known of its motion. Distances are in 1/16 of a lattice step.
struct MovingVertex {
  GridPoint at;
  std::int32_t velocity = 0;  ///< expected move along the outward normal to the next layer
  std::int32_t change = 0;    ///< expected of that from layer to layer
  std::int32_t last = 0;      ///< the residual it had, a context for the next
  bool no_history = true;     ///< no motion was seen yet
};
using MovingRing = std::vector<MovingVertex>;

inline constexpr std::int32_t kDistanceUnit = 16;
inline constexpr std::int32_t kMaxDistance = 1 << 24;

/// Direction in 1/16384; points outwards on counter-clockwise rings.
struct Normal {
  std::int32_t x = 0;
  std::int32_t y = 0;
};

/// The shape of a ring around one vertex.
struct Corner {
  Normal normal;
  unsigned bend = 0;  ///< bit length of its distance, in half steps, to the chord of its neighbours; at most 11
};

[[nodiscard]] Normal normal_of(GridPoint from, GridPoint to);
[[nodiscard]] std::vector<Corner> corners_of(std::span<const MovingVertex> ring);

/// May lie outside the lattice.
[[nodiscard]] GridPoint moved(GridPoint p, Normal normal, std::int32_t distance);
[[nodiscard]] inline GridPoint middle(GridPoint a, GridPoint b) { return {(a.x + b.x) / 2, (a.y + b.y) / 2}; }
/// Twice the binary logarithm of the distance, rounded down; at most 31.
[[nodiscard]] unsigned length_class(GridPoint a, GridPoint b);

/// Round to nearest, halves up.
[[nodiscard]] constexpr std::int32_t divided(std::int32_t value, std::int32_t by) {
  const std::int64_t v = 2 * std::int64_t{value} + by;
  const std::int64_t d = 2 * std::int64_t{by};
  return static_cast<std::int32_t>(v >= 0 ? v / d : -((-v + d - 1) / d));
}

/// What the next move along the normal will be, given the move of the vertex before it in this layer.
struct MoveRule {
  std::int32_t step = 4;  ///< a residual of 1, in lattice steps

  /// The move that residual 0 stands for.
  [[nodiscard]] std::int32_t expected(const MovingVertex& v, std::int32_t move_before) const {
    return v.no_history ? divided(move_before, step * kDistanceUnit) * step * kDistanceUnit : v.velocity;
  }
  /// The vertex after a move of expected + residual steps. False where a limit is broken.
  [[nodiscard]] bool apply(MovingVertex& v, Normal normal, std::int32_t expected_move, std::int32_t residual,
                           GridPoint most) const;
};

/// Neighbours move alike: each velocity goes 7/8 of the way to the mean of its two neighbours', then half of it, and
/// its change 7/8. Residuals are coarse, and this takes their rounding out of the next layer's expectation.
void smooth_motion(MovingRing& ring);

/// A vertex put between two of the same ring: over their middle, `offset` units aside. False outside the lattice.
[[nodiscard]] bool make_between(const MovingVertex& a, const MovingVertex& b, std::int32_t offset, std::int32_t step,
                                GridPoint most, MovingVertex& made);

}  // namespace telefab::codec
