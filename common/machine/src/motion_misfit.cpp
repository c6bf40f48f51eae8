// SPDX-License-Identifier: GPL-3.0-or-later
#include "motion_misfit.hpp"

#include <fmt/format.h>

namespace telefab {

std::optional<std::string> misfit_of(const MachineProfile::Motion& motion) {
  for (const bool is_bottom : {false, true})
    for (const bool is_large : {false, motion.large_area_mm2 > 0}) {
      const MachineProfile::Stroke s = motion.stroke_of(is_bottom, is_large);
      const char* layers = is_bottom ? "a bottom layer" : is_large ? "a large layer" : "a layer";
      if (s.lift_mm == 0 && s.tilt_s == 0)
        return fmt::format("{} has neither motion.lift_mm nor motion.tilt_s above 0, so its film never comes off",
                           layers);
      if (s.peel_mm > s.lift_mm)
        return fmt::format("of {} motion.peel_mm is {} mm, more than its motion.lift_mm of {} mm", layers, s.peel_mm,
                           s.lift_mm);
      if (s.peel_mm > 0 && s.peel_speed_mm_per_s == 0)
        return fmt::format("{} has motion.peel_mm, so motion.peel_speed_mm_per_s must be stated", layers);
      if (s.approach_mm > 0 && s.approach_speed_mm_per_s == 0)
        return fmt::format("{} has motion.approach_mm, so motion.approach_speed_mm_per_s must be stated", layers);
    }
  return std::nullopt;
}

}  // namespace telefab
