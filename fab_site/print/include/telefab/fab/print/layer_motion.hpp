// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <telefab/base/result.hpp>
#include <telefab/fab/device/stage_path.hpp>
#include <telefab/machine/machine_profile.hpp>
#include <vector>

namespace telefab::fab {

/// How the machine moves and waits around the exposure of one layer, in the order of the members: lowering to it, rest,
/// (light,) rest, tilt, lift, rest on top. Millimetres, mm/s and seconds; what is 0 is left out.
struct LayerMotion {
  double lower_speed_mm_per_s = 3;
  double approach_mm = 0;  ///< last part of the lowering
  double approach_speed_mm_per_s = 0;
  double settle_s = 0.5;
  double wait_after_exposure_s = 0;
  double tilt_s = 0;
  double peel_mm = 0;  ///< first part of the lift
  double peel_speed_mm_per_s = 0;
  double lift_mm = 5;  ///< whole; 0 where the vat tips instead
  double lift_speed_mm_per_s = 2;
  double wait_after_lift_s = 0;
  friend bool operator==(const LayerMotion&, const LayerMotion&) = default;
  /// InvalidInput names the member: lengths and times finite and not negative, at most 1000 mm and an hour; a lift or a
  /// tilt; parts within the lift; a speed for every part there is.
  [[nodiscard]] Result<void> validate() const;
};

/// Of a layer that lights so much: Motion::stroke_of.
[[nodiscard]] LayerMotion motion_of(const MachineProfile::Motion& motion, bool is_bottom, double lit_mm2);

/// Up from a layer at z_mm: slow at first where it is peeled, then fast. Empty without a lift.
[[nodiscard]] std::vector<StageLeg> lift_path(const LayerMotion& motion, double z_mm);
/// To a layer at z_mm from a gap of from_mm: fast, and slow for the last part.
[[nodiscard]] std::vector<StageLeg> lowering_path(const LayerMotion& motion, double z_mm, double from_mm);

}  // namespace telefab::fab
