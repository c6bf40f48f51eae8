// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <array>
#include <telefab/fab/cure/support_calibration.hpp>
#include <telefab/fab/mask/pixel_rings.hpp>

namespace telefab::fab {

struct PixelPlace {
  int x = 0, y = 0;
};

/// A disc on three necks, in pixels from its middle: the corner of four pixels or, where `odd`, the middle of one.
struct DiscShape {
  bool odd = false;
  int radius_px = 0;
  int moved_px = 0;  ///< the necks towards the front
  double neck_radius_px = 0;
  int disc_area_px = 0, neck_area_px = 0;

  [[nodiscard]] std::array<PixelPlace, 3> necks() const;
  /// Stress over pull in the neck that bears most: the three bear what balances the pull, no other way is open.
  [[nodiscard]] double demand() const;
  /// Layers until cones of 45 degrees from the necks have grown to the full disc.
  [[nodiscard]] int cone_layers(double layer_px) const;
};

/// A wall that jumps along x, in pixels.
struct ShelfShape {
  int wall_px = 0, width_px = 0, overhang_px = 0;
};

struct PlacedSpecimen {
  SupportSpecimen specimen;
  DiscShape disc;    ///< of discs
  ShelfShape shelf;  ///< of shelves
  PixelPlace at;     ///< discs: pixel at the upper right of the middle, or the middle one; shelves: front left pixel
};

/// All of a machine's print in pixels and layers.
struct SupportLayout {
  std::vector<PlacedSpecimen> specimens;
  int disc_px = 0;  ///< diameter
  int block_left = 0, block_front = 0, block_right = 0, block_back = 0;
  int block_layers = 0, neck_layers = 0, disc_layers = 0, upright_layers = 0;
  int layers = 0;
  double layer_px = 0;  ///< thickness of a layer in pixels
};

/// As support_specimens().
[[nodiscard]] Result<SupportLayout> support_layout(const MachineProfile& machine);

/// Whether a pixel's middle lies within the radius of the shape's middle; offsets in pixels from DiscShape's.
[[nodiscard]] inline bool within(bool odd, int x, int y, double radius_px) {
  const double half = odd ? 0 : 0.5, dx = x + half, dy = y + half;
  return dx * dx + dy * dy <= radius_px * radius_px;
}

}  // namespace telefab::fab
