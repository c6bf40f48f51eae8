// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <telefab/fab/support/support_plan.hpp>

namespace telefab::fab {

/// A pin from the platform to the part, upright: foot, shaft, cone, waist and contact disc.
struct TipShape {
  double disc_mm = 0;         ///< radius of the contact disc
  double depth_mm = 0;        ///< how far it goes into the part, where that is so thick
  double neck_mm = 0;         ///< radius of the waist under it, where the pin breaks off
  double tip_mm = 0;          ///< height from the waist to the contact
  double cone_mm = 0;         ///< height from the shaft to the waist
  double pin_mm = 0;          ///< radius of the shaft at its upper end
  double base_mm = 0;         ///< radius of the shaft at its lower end
  double foot_mm = 0;         ///< radius on the platform
  double foot_height_mm = 0;  ///< of the cone from there to the shaft

  /// From the shaft to the contact.
  [[nodiscard]] double length_mm() const { return tip_mm + cone_mm; }
  /// mm2: the section that bears.
  [[nodiscard]] double neck_area_mm2() const;
  /// 1/mm: length over area, summed over a pin whose contact is at that height above the platform.
  [[nodiscard]] double softness(double height_mm) const;
};

/// Of the cone on the platform. A plate hides it: above one it would only enclose resin with its neighbours.
[[nodiscard]] double foot_height_mm(const MachineProfile::Supports& supports);

/// Of a pin whose contact is at that height above the platform; `layer_mm` is the thickness of a layer. A long pin is
/// soft and leaves its load to short ones, so that few bear all: shafts are as wide as their height asks, within
/// limits, and tips about equally soft for their areas.
[[nodiscard]] TipShape tip_shape(const MachineProfile& machine, TipClass tip, double height_mm, double layer_mm);

}  // namespace telefab::fab
