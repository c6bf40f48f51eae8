// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <array>
#include <telefab/fab/mask/mask.hpp>

namespace telefab::fab {

/// What stands between a mask and the vat, as OpticsTurn names it. Each one undoes itself.
struct Orientation {
  bool mirrors_x = false;  ///< left becomes right
  bool mirrors_y = false;  ///< front becomes back; with mirrors_x: turned by half a circle
  friend bool operator==(const Orientation&, const Orientation&) = default;
};

[[nodiscard]] Orientation orientation_of(OpticsTurn turn);

/// The picture that the light engine must show, so that the optics lay the mask itself on the vat.
[[nodiscard]] Mask turned_for_optics(const MaskView& mask, Orientation optics);

/// The left and the right half of the columns, for mirrors that two controllers drive. The width is even.
[[nodiscard]] std::array<Mask, 2> halves_of(const MaskView& mask);

}  // namespace telefab::fab
