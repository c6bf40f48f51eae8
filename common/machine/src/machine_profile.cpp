// SPDX-License-Identifier: GPL-3.0-or-later
#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <telefab/base/nearest_name.hpp>
#include <telefab/machine/exposure_time.hpp>
#include <telefab/machine/machine_profile.hpp>

namespace telefab {

bool MachineProfile::states_calibration_band() const {
  return resin.critical_dose_least_mj_per_cm2 > 0 && resin.penetration_least_mm > 0;
}

bool MachineProfile::is_assumed(std::string_view key) const {
  return std::find(assumed.begin(), assumed.end(), key) != assumed.end();
}

bool MachineProfile::states_what_carries() const {
  return motion.pull_kpa > 0 && resin.green_strength_mpa > 0 && !is_assumed("motion.pull_kpa") &&
         !is_assumed("resin.green_strength_mpa");
}

MachineProfile::Stroke MachineProfile::Motion::stroke_of(bool is_bottom, bool is_large) const {
  const auto pick = [&](double Stroke::*of, double of_all) {
    if (is_bottom && bottom.*of > 0) return bottom.*of;
    if (is_large && large.*of > 0) return large.*of;
    return of_all;
  };
  return {.lift_mm = pick(&Stroke::lift_mm, lift_mm),
          .lift_speed_mm_per_s = pick(&Stroke::lift_speed_mm_per_s, lift_speed_mm_per_s),
          .peel_mm = pick(&Stroke::peel_mm, peel_mm),
          .peel_speed_mm_per_s = pick(&Stroke::peel_speed_mm_per_s, peel_speed_mm_per_s),
          .lower_speed_mm_per_s = pick(&Stroke::lower_speed_mm_per_s, lower_speed_mm_per_s),
          .approach_mm = pick(&Stroke::approach_mm, approach_mm),
          .approach_speed_mm_per_s = pick(&Stroke::approach_speed_mm_per_s, approach_speed_mm_per_s),
          .settle_s = pick(&Stroke::settle_s, settle_s),
          .wait_after_exposure_s = pick(&Stroke::wait_after_exposure_s, wait_after_exposure_s),
          .wait_after_lift_s = pick(&Stroke::wait_after_lift_s, wait_after_lift_s),
          .tilt_s = pick(&Stroke::tilt_s, tilt_s)};
}

double MachineProfile::exposure_step_s() const {
  constexpr double kGrblDwell_s = 0.05, kMillisecond_s = 0.001;
  if (devices.light == LightSwitch::Projector) return 0;
  return devices.stage == StageKind::Grbl ? kGrblDwell_s : kMillisecond_s;
}

double MachineProfile::exposure_of_layer_s(std::uint32_t print_layer) const {
  if (print_layer < layers.bottom_count) return layers.bottom_exposure_s;
  const std::uint32_t above = print_layer - layers.bottom_count;
  if (above >= layers.transition_count) return layers.exposure_s;
  // The dose falls in even steps; where all light is alike, so does the time.
  const double from = layers.bottom_exposure_s * light_share_of_layer(0) / layers.light_share;
  const double even = from + (layers.exposure_s - from) * (above + 1) / (layers.transition_count + 1);
  return timed_exposure_s(*this, even);
}

double timed_exposure_s(const MachineProfile& machine, double seconds) {
  const double step_s = machine.exposure_step_s();
  return step_s > 0 ? std::max(1.0, std::round(seconds / step_s)) * step_s : seconds;
}

double MachineProfile::light_share_of_layer(std::uint32_t print_layer) const {
  const bool is_bottom = print_layer < layers.bottom_count && layers.bottom_light_share > 0;
  return is_bottom ? layers.bottom_light_share : layers.light_share;
}

MachineProfile MachineProfile::at_full_light() const {
  MachineProfile full = *this;
  full.layers.exposure_s *= layers.light_share;
  full.layers.bottom_exposure_s *= light_share_of_layer(0);
  full.layers.light_share = 1;
  full.layers.bottom_light_share = 0;
  // A shorter exposure at full light is only computed with; no device will time it.
  if (layers.light_share != 1 || light_share_of_layer(0) != 1) full.devices.light = LightSwitch::Projector;
  return full;
}

std::array<double, 3> MachineProfile::drawn_scale() const {
  const auto longer = [](double shrink_percent) { return 100 / (100 - shrink_percent); };
  return {longer(resin.shrink_x_percent), longer(resin.shrink_y_percent), longer(resin.shrink_z_percent)};
}

double MachineProfile::homing_mm_per_s() const {
  constexpr double kVirtual = 20, kReal = 2;
  if (motion.homing_speed_mm_per_s > 0) return motion.homing_speed_mm_per_s;
  return devices.stage == StageKind::Virtual ? kVirtual : kReal;
}

double MachineProfile::highest_lift_mm() const {
  return std::max({motion.lift_mm, motion.large_area_mm2 > 0 ? motion.large.lift_mm : 0, motion.bottom.lift_mm});
}

PixelSize MachineProfile::mask_size() const {
  // 260 / 0.14 is 1857.14; a ratio that is whole but for rounding counts as whole.
  const auto pixels = [&](double side) {
    return static_cast<std::uint32_t>(std::max(1.0, std::floor(side / projection.pixel_pitch_mm + 1e-9)));
  };
  return {pixels(platform.width_mm), pixels(platform.depth_mm)};
}

Result<MachineProfile> find_machine(const std::vector<MachineProfile>& machines, std::string_view name) {
  const auto found = std::find_if(machines.begin(), machines.end(), [&](const auto& m) { return m.name == name; });
  if (found != machines.end()) return *found;
  std::vector<std::string> names;
  for (const auto& machine : machines) names.push_back(machine.name);
  return fail(ErrorCode::InvalidInput,
              fmt::format("no machine named {}; {}", name, names_instead(name, names, "`machines`")));
}

Digest digest_of_profile(MachineProfile profile) {
  profile.devices = {};
  profile.screen = {};
  profile.light = {};
  profile.file = {};
  profile.assumed.clear();
  Hasher hasher;
  hasher.feed(to_toml(profile));
  return hasher.digest();
}

}  // namespace telefab
