// SPDX-License-Identifier: GPL-3.0-or-later
#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <cmath>
#include <telefab/machine/machine_profile.hpp>

namespace telefab {

double MachineProfile::pull_of_film_kpa() const {
  constexpr double kAssumedKpa = 20;
  return motion.pull_kpa > 0 ? motion.pull_kpa : kAssumedKpa;
}

double MachineProfile::carried_demand() const {
  constexpr double kKilo = 1000;
  constexpr double kAssumedMpa = 10;
  const double strength_mpa = resin.green_strength_mpa > 0 ? resin.green_strength_mpa : kAssumedMpa;
  return kKilo * strength_mpa * supports.fresh_share / (supports.safety * pull_of_film_kpa());
}

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
  std::vector<std::string_view> names;
  for (const auto& machine : machines) names.push_back(machine.name);
  return fail(ErrorCode::InvalidInput, fmt::format("no machine named {}; there are: {}", name, fmt::join(names, ", ")));
}

Digest digest_of_profile(MachineProfile profile) {
  profile.devices = {};
  profile.assumed.clear();
  Hasher hasher;
  hasher.feed(to_toml(profile));
  return hasher.digest();
}

}  // namespace telefab
