// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <span>

#include "load_path.hpp"

namespace telefab::fab {

/// One section of a cut and how stiff what it stands on is.
struct CutPart {
  const Section* section = nullptr;
  double stiffness = 0;  ///< area over length, mm, or anything in proportion to it
  double below_mm = 0;   ///< of the layer just exposed
};

/// Pull on an area, its middle, and what goes sideways with it.
struct Pull {
  double area_mm2 = 0;
  Point2 middle;
  double sideways_share = 0;
};

/// Stresses over pull in a cut.
struct CutStress {
  double mean = 0;
  double lever = 0;          ///< at the middle of the part that bears most
  std::size_t lever_at = 0;  ///< which
  double bending = 0;        ///< at its rim
  std::size_t bending_at = 0;
};

/// What a rigid body on springs gives to each: pulled off the middle of their stiffness it turns, and springs far out
/// on that side bear more. `parts` are not empty; none is without area or stiffness.
[[nodiscard]] CutStress stress_of(std::span<const CutPart> parts, const Pull& pull);

}  // namespace telefab::fab
