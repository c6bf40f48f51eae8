// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <span>
#include <telefab/geometry/contour.hpp>
#include <vector>

namespace telefab::fab {

/// Where two edges of a layer face each other at less than some distance.
struct NarrowPlace {
  enum class Kind : std::uint8_t {
    Wall = 1,  ///< material between the edges
    Gap = 2,   ///< resin between them
  };
  Kind kind = Kind::Wall;
  Point2 middle;         ///< half way between the edges, build frame
  double width_mm = 0;   ///< from edge to edge; of a speck 4 area / perimeter
  double length_mm = 0;  ///< of wall or gap that this place stands for
  friend bool operator==(const NarrowPlace&, const NarrowPlace&) = default;
};

/// Walls and gaps narrower than `below_mm`, looked for every `step_mm` along the rings, straight across. The tip of a
/// corner is no wall: edges that meet within 1.5 `below_mm` along the ring do not face each other. A ring shorter than
/// 3 `below_mm` is a speck and one place. Rings as rasterise() takes them: material to the left of the way round.
/// Order: that of the rings and along them. Both lengths must be positive. Cost: proportional to the length of the
/// rings over the step.
[[nodiscard]] std::vector<NarrowPlace> narrow_places(std::span<const Contour> rings, double below_mm, double step_mm);

}  // namespace telefab::fab
