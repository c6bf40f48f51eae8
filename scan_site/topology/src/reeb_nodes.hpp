// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include "ring.hpp"
#include "steepest_line.hpp"

namespace telefab::scan::topology {

/// A node while it is built: the rings that end at it and those that begin, traced beside it.
struct NodeRings {
  ReebNode node;
  double level_below_mm = 0;
  double level_above_mm = 0;
  std::vector<Ring> below;
  std::vector<Ring> above;
  /// Where a curve up from each ring above starts: a line already traced from a saddle, or a point.
  std::vector<std::optional<std::size_t>> line_above;
  int euler = 0;              ///< of the piece of surface between the rings
  int euler_step = 0;         ///< of the slice, from below to above
  std::string inconsistency;  ///< why it is not resolved
};

/// A run of critical heights too near to be ordered, and where the rings beside it are traced.
struct Level {
  double low, high;
  double below, above;
  friend bool operator==(const Level&, const Level&) = default;
};

/// What lies about a critical point outside plateaus.
struct Around {
  Level level;
  std::vector<IntegralLine> lines;
  std::vector<Ring> below, above;
};

/// What was traced about these critical points and plateaus before. The same heights in another order ask for little
/// that is new.
struct NodeMemory {
  struct Known {
    Level asked;
    Around seen;
  };
  std::vector<std::optional<Known>> alone;   ///< points that are a run of their own
  std::vector<std::optional<Known>> in_run;  ///< points among others
  std::vector<std::optional<NodeRings>> flat;
};

/// Traces four lines a saddle (outside plateaus) and the rings around every node. Critical points nearly at one
/// height (within `run_kernels` * h) on one contour become one node. Fails with Cancelled.
struct TracedNodes {
  std::vector<IntegralLine> lines;
  std::vector<NodeRings> nodes;  ///< sorted by level below
};
[[nodiscard]] Result<TracedNodes> trace_nodes(const ScalarField& field, std::span<const Vec3> samples,
                                              std::span<const Vec3> normals, std::span<const CriticalPoint> points,
                                              std::span<const Plateau> plateaus, const CriticalIndex& index,
                                              double run_kernels, NodeMemory& memory, std::stop_token stop);

/// Point of a path strictly monotone in z, at height z; none outside.
[[nodiscard]] std::optional<Vec3> point_at_height(std::span<const Vec3> path, double z_mm);

}  // namespace telefab::scan::topology
