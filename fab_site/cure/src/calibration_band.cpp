// SPDX-License-Identifier: GPL-3.0-or-later
#include <telefab/fab/cure/calibration_band.hpp>

#include <algorithm>
#include <cmath>

namespace telefab::fab {

std::optional<CalibrationBand> calibration_band(const MachineProfile& machine, double dose_mj_per_cm2) {
  if (!machine.states_calibration_band()) return std::nullopt;
  const auto& resin = machine.resin;
  const double depth_mm = resin.penetration_mm;
  const double log_dose = std::log(dose_mj_per_cm2 / resin.critical_dose_mj_per_cm2);
  const double half_log = std::log(resin.critical_dose_most_mj_per_cm2 / resin.critical_dose_least_mj_per_cm2) / 2;
  const double half_mm = (resin.penetration_most_mm - resin.penetration_least_mm) / 2;
  // Half the interval of a * Dp + b * ln Ec.
  const auto half_of = [&](double a, double b) {
    const double x = a * half_mm, y = b * half_log;
    return std::sqrt(std::max(0.0, x * x + y * y + 2 * resin.calibration_correlation * x * y));
  };
  // Depth = Dp (ln E - ln Ec); the dose through a layer of height t is Ec exp(t / Dp).
  const double cured_mm = depth_mm * log_dose, half_depth_mm = half_of(log_dose, -depth_mm);
  const double through = half_of(-machine.layers.thickness_mm / (depth_mm * depth_mm), 1);
  return CalibrationBand{cured_mm - half_depth_mm, cured_mm + half_depth_mm, std::expm1(through)};
}

}  // namespace telefab::fab
