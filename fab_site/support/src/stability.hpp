// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <telefab/fab/support/support_plan.hpp>

namespace telefab::fab {

/// How a print stands on what holds it, in its worst moment.
struct Stability {
  double slack_mm = 0;  ///< the centre of mass keeps this far inside the hull of what holds it; negative: it leaves it
  LayerIndex layer;     ///< of the part: the moment, this layer being printed
  Point2 centre;        ///< of mass of the part up to that layer
  Point2 lean;          ///< unit vector from the hull towards where it wants to fall
};

/// Judges every layer: the part up to there, its centre of mass and the convex hull of what holds it (the
/// contact discs of all anchors up to there, and the part's first layer where `stands`). The slack is counted from a
/// twentieth of the centre's height inside the hull.
[[nodiscard]] Stability stability_of(std::span<const Region> layers, std::span<const Anchor> anchors, bool stands,
                                     const MachineProfile& machine);

/// Anchors on the part's underside that keep a lifted part over its pins; none if nothing helps.
[[nodiscard]] std::vector<Anchor> stabilising_anchors(std::span<const Region> layers, std::span<const Anchor> anchors,
                                                      const MachineProfile& machine);

}  // namespace telefab::fab
