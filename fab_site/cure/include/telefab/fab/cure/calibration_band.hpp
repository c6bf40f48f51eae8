// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <optional>
#include <telefab/machine/machine_profile.hpp>

namespace telefab::fab {

/// What the confidence of a calibration means for a print: intervals of 95 %, to first order in the errors of Dp and
/// ln Ec, which go together.
struct CalibrationBand {
  double least_depth_mm = 0;  ///< cured by a dose at least
  double most_depth_mm = 0;   ///< and at most
  /// The dose that cures a layer through is known to within this share: an error of it is the same as one of the light.
  double dose_share = 0;
};

/// Of a dose in mJ/cm2, for layers of the profile. Nothing where the profile states no intervals.
[[nodiscard]] std::optional<CalibrationBand> calibration_band(const MachineProfile& machine, double dose_mj_per_cm2);

}  // namespace telefab::fab
