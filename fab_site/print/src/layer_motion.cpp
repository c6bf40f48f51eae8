// SPDX-License-Identifier: GPL-3.0-or-later
#include <fmt/format.h>

#include <cmath>
#include <telefab/fab/print/layer_motion.hpp>

namespace telefab::fab {

Result<void> LayerMotion::validate() const {
  constexpr double kLongest_mm = 1000, kLongest_s = 3600;
  const auto bad = [](std::string_view what) { return fail(ErrorCode::InvalidInput, std::string{what}); };
  const auto within = [](double value, double most) { return value >= 0 && value <= most; };
  for (const double mm : {approach_mm, peel_mm, lift_mm})
    if (!within(mm, kLongest_mm)) return bad("a part of its lift or lowering is not within 0 and 1000 mm");
  for (const double s : {settle_s, wait_after_exposure_s, tilt_s, wait_after_lift_s})
    if (!within(s, kLongest_s)) return bad("a wait or its tilt is not within 0 and 3600 s");
  if (lift_mm == 0 && tilt_s == 0) return bad("it has neither a lift nor a tilt, so its film never comes off");
  if (peel_mm > lift_mm)
    return bad(fmt::format("its peel of {} mm is longer than its lift of {} mm", peel_mm, lift_mm));
  const auto moves = [](double speed) { return std::isfinite(speed) && speed > 0; };
  if (!moves(lift_speed_mm_per_s) || !moves(lower_speed_mm_per_s))
    return bad("the speeds of its lift and lowering must be positive and finite");
  if (peel_mm > 0 && !moves(peel_speed_mm_per_s)) return bad("the speed of its peel must be positive and finite");
  if (approach_mm > 0 && !moves(approach_speed_mm_per_s))
    return bad("the speed of its approach must be positive and finite");
  return {};
}

LayerMotion motion_of(const MachineProfile::Motion& motion, bool is_bottom, double lit_mm2) {
  const bool is_large = motion.large_area_mm2 > 0 && lit_mm2 > motion.large_area_mm2;
  const MachineProfile::Stroke stroke = motion.stroke_of(is_bottom, is_large);
  return {.lower_speed_mm_per_s = stroke.lower_speed_mm_per_s,
          .approach_mm = stroke.approach_mm,
          .approach_speed_mm_per_s = stroke.approach_speed_mm_per_s,
          .settle_s = stroke.settle_s,
          .wait_after_exposure_s = stroke.wait_after_exposure_s,
          .tilt_s = stroke.tilt_s,
          .peel_mm = stroke.peel_mm,
          .peel_speed_mm_per_s = stroke.peel_speed_mm_per_s,
          .lift_mm = stroke.lift_mm,
          .lift_speed_mm_per_s = stroke.lift_speed_mm_per_s,
          .wait_after_lift_s = stroke.wait_after_lift_s};
}

std::vector<StageLeg> lift_path(const LayerMotion& motion, double z_mm) {
  std::vector<StageLeg> legs;
  if (motion.lift_mm <= 0) return legs;
  if (motion.peel_mm > 0) legs.push_back({z_mm + motion.peel_mm, motion.peel_speed_mm_per_s});
  if (motion.peel_mm < motion.lift_mm) legs.push_back({z_mm + motion.lift_mm, motion.lift_speed_mm_per_s});
  return legs;
}

std::vector<StageLeg> lowering_path(const LayerMotion& motion, double z_mm, double from_mm) {
  std::vector<StageLeg> legs;
  const bool is_near = motion.approach_mm > 0 && from_mm <= z_mm + motion.approach_mm;
  if (!is_near && motion.approach_mm > 0) legs.push_back({z_mm + motion.approach_mm, motion.lower_speed_mm_per_s});
  legs.push_back({z_mm, motion.approach_mm > 0 ? motion.approach_speed_mm_per_s : motion.lower_speed_mm_per_s});
  return legs;
}

}  // namespace telefab::fab
