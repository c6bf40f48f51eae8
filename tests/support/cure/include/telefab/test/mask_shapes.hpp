// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <string>
#include <telefab/fab/cure/edge_error.hpp>
#include <telefab/fab/mask/mask.hpp>
#include <telefab/machine/machine_profile.hpp>

namespace telefab::test {

/// A machine with pixels of 0.05 mm whose white area gets one Ec a second, light spots of `spread_px`, no gamma.
[[nodiscard]] MachineProfile judge_machine(double spread_px);

/// Contours on which ways of making masks are compared. Coordinates in millimetres on judge_machine().
struct MaskShape {
  std::string family;  ///< e.g. "circle 3"
  std::vector<Contour> rings;
};
/// Circles of radius 3 to 30 px, squares at 0, 7, 22 and 45 degrees, a gear, a star, strokes of 2 and 3 px; each at
/// three sub-pixel offsets.
[[nodiscard]] std::vector<MaskShape> mask_shapes();

/// A straight wall, or a gap in a block, of a width in pixels through the middle of the mask.
struct ThinFeature {
  std::vector<Contour> rings;
  fab::PixelPlace middle;
  double normal_x = 0;  ///< across it
  double normal_y = 0;
  bool gap = false;
};
/// Every offset of an eighth of a pixel at 0, 10, 22.5, 35 and 45 degrees.
[[nodiscard]] std::vector<ThinFeature> thin_features(double width_px, bool gaps);
/// The width that is cured (of a gap: left open) along the feature's middle, least and most over several lines across.
struct KeptWidth {
  double least_px = 0;
  double most_px = 0;
  double mean_px = 0;
};
[[nodiscard]] KeptWidth kept_width(const fab::DoseField& dose, double threshold, const ThinFeature& feature);

/// The dose of one mask alone whose white cures at the share `tau` of its dose: the level to compare with is one.
[[nodiscard]] fab::DoseField exposed(const MachineProfile& machine, const fab::Mask& mask, double tau);
/// How one mask, exposed like that, meets its contours.
[[nodiscard]] fab::EdgeFigures judge(const MachineProfile& machine, const fab::Mask& mask, double tau,
                                     std::span<const Contour> rings);

/// What slicers without grey do: a pixel whose middle lies inside is white.
[[nodiscard]] fab::Mask binary_mask(const MachineProfile& machine, std::span<const Contour> rings);

}  // namespace telefab::test
