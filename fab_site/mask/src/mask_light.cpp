// SPDX-License-Identifier: GPL-3.0-or-later
#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <telefab/fab/mask/mask_light.hpp>

namespace telefab::fab {

double MaskLight::passed() const { return std::exp(-layer_mm / penetration_mm); }
double MaskLight::threshold() const { return std::exp(layer_mm / (2 * penetration_mm)) / white; }
double MaskLight::through() const { return std::exp(layer_mm / penetration_mm) / white; }

Result<MaskLight> mask_light(const MachineProfile& machine) {
  const struct {
    const char* key;
    double value;
  } figures[] = {{"projection.spread_px", machine.projection.spread_px},
                 {"projection.irradiance_mw_per_cm2", machine.projection.irradiance_mw_per_cm2},
                 {"layers.thickness_mm", machine.layers.thickness_mm},
                 {"layers.exposure_s", machine.layers.exposure_s},
                 {"resin.critical_dose_mj_per_cm2", machine.resin.critical_dose_mj_per_cm2},
                 {"resin.penetration_mm", machine.resin.penetration_mm}};
  for (const auto& [key, value] : figures)
    if (!std::isfinite(value) || value <= 0)
      return fail(ErrorCode::InvalidInput,
                  fmt::format("machine {}: {} is {}; grey masks need a positive figure. Set it, or use --masks cover",
                              machine.name, key, value));
  if (machine.projection.spread_px < 0.05 || machine.projection.spread_px > 3.5)
    return fail(ErrorCode::InvalidInput,
                fmt::format("machine {}: projection.spread_px is {}; grey masks can be solved for 0.05 to 3.5. Set it, "
                            "or use --masks cover",
                            machine.name, machine.projection.spread_px));
  MaskLight light;
  light.spread_px = machine.projection.spread_px;
  light.white = machine.projection.irradiance_mw_per_cm2 * machine.at_full_light().layers.exposure_s /
                machine.resin.critical_dose_mj_per_cm2;
  light.layer_mm = machine.layers.thickness_mm;
  light.penetration_mm = machine.resin.penetration_mm;
  light.tone = tone_of(machine.projection);
  light.projection = machine.projection;
  return light;
}

GreyEncoder::GreyEncoder(const std::array<double, 256>& tone) {
  for (std::size_t grey = 0; grey + 1 < tone.size(); ++grey)
    upto_[grey] = static_cast<float>((tone[grey] + tone[grey + 1]) / 2);
  upto_.back() = std::numeric_limits<float>::infinity();
  for (int slot = 0; slot <= kSlots; ++slot) {
    const auto lowest = static_cast<float>(slot) / kSlots;
    const auto at = std::find_if(upto_.begin(), upto_.end(), [&](float upto) { return lowest <= upto; });
    first_[static_cast<std::size_t>(slot)] = static_cast<std::uint8_t>(at - upto_.begin());
  }
}

std::uint8_t GreyEncoder::operator()(float irradiance) const {
  const float inside = std::clamp(irradiance, 0.0F, 1.0F);
  std::uint8_t grey = first_[static_cast<std::size_t>(inside * kSlots)];
  while (inside > upto_[grey]) ++grey;
  return grey;
}

}  // namespace telefab::fab
