// SPDX-License-Identifier: GPL-3.0-or-later
#include <fmt/format.h>

#include <cmath>
#include <telefab/fab/cure/cure_model.hpp>

namespace telefab::fab {

double CureModel::passed() const { return std::exp(-layer_mm / penetration_mm); }
double CureModel::to_middle() const { return std::exp(layer_mm / (2 * penetration_mm)); }
double CureModel::leaked_dose(std::chrono::nanoseconds exposure) const {
  return leak * white_per_s * std::chrono::duration<double>(exposure).count() / (1 - passed());
}

Result<CureModel> cure_model(const MachineProfile& machine) {
  const struct {
    const char* key;
    double value;
  } figures[] = {{"projection.pixel_pitch_mm", machine.projection.pixel_pitch_mm},
                 {"projection.spread_px", machine.projection.spread_px},
                 {"projection.irradiance_mw_per_cm2", machine.projection.irradiance_mw_per_cm2},
                 {"layers.thickness_mm", machine.layers.thickness_mm},
                 {"resin.critical_dose_mj_per_cm2", machine.resin.critical_dose_mj_per_cm2},
                 {"resin.penetration_mm", machine.resin.penetration_mm}};
  for (const auto& [key, value] : figures)
    if (!std::isfinite(value) || value <= 0)
      return fail(ErrorCode::InvalidInput,
                  fmt::format("machine {}: {} is {}; it must be positive", machine.name, key, value));
  if (machine.projection.spread_px < 0.05 || machine.projection.spread_px > 5)
    return fail(ErrorCode::InvalidInput, fmt::format("machine {}: projection.spread_px is {}; 0.05 to 5 is possible",
                                                     machine.name, machine.projection.spread_px));
  CureModel model;
  model.mask = machine.mask_size();
  model.pixel_pitch_mm = machine.projection.pixel_pitch_mm;
  model.layer_mm = machine.layers.thickness_mm;
  model.penetration_mm = machine.resin.penetration_mm;
  model.spread_px = machine.projection.spread_px;
  model.white_per_s = machine.projection.irradiance_mw_per_cm2 / machine.resin.critical_dose_mj_per_cm2;
  const auto tone = tone_of(machine.projection);
  for (std::size_t grey = 0; grey < tone.size(); ++grey) model.tone[grey] = static_cast<float>(tone[grey]);
  model.leak = tone[0];
  model.projection = machine.projection;
  return model;
}

}  // namespace telefab::fab
