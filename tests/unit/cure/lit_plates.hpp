// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <telefab/fab/cure/cured_solid.hpp>

namespace telefab::fab::test {

using namespace std::chrono_literals;

/// 64 x 48 pixels of 0.1 mm, layers of 0.1 mm, Dp 0.2 mm, white 2 Ec a second.
inline MachineProfile plate_machine() {
  MachineProfile m;
  m.name = "plate";
  m.platform = {6.4, 4.8, 50};
  m.projection.pixel_pitch_mm = 0.1;
  m.projection.irradiance_mw_per_cm2 = 10;
  m.layers = {0.1, 2.0, 0, 2.0};
  m.resin = {"assumed", 5, 0.2};
  return m;
}

inline Mask mask_of(PixelSize size, const std::function<int(int column, int row)>& grey) {
  Mask mask{size, {}};
  for (std::uint32_t r = 0; r < size.height_px; ++r)
    for (std::uint32_t c = 0; c < size.width_px; ++c)
      mask.rows.push_back(static_cast<std::uint8_t>(grey(static_cast<int>(c), static_cast<int>(r))));
  return mask;
}

inline LitLayer lit(Mask mask, std::chrono::nanoseconds time) {
  LitLayer layer;
  layer.masks.push_back(std::move(mask));
  layer.lit.push_back(time);
  return layer;
}

/// The field of one layer that is lit alone.
inline DoseField field_of(const CureModel& model, const Mask& mask, std::chrono::nanoseconds time) {
  DoseStream stream{model};
  const MaskExposure exposure{mask.view(), time};
  return stream.descend({&exposure, 1}).value();
}

}  // namespace telefab::fab::test
