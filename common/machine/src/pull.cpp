// SPDX-License-Identifier: GPL-3.0-or-later
#include <algorithm>
#include <cmath>
#include <telefab/machine/machine_profile.hpp>

namespace telefab {
namespace {

constexpr double kKilo = 1000;  // MPa to kPa

}  // namespace

double MachineProfile::pull_of_film_kpa() const {
  constexpr double kAssumedKpa = 20;
  return motion.pull_kpa > 0 ? motion.pull_kpa : kAssumedKpa;
}

double MachineProfile::vacuum_of_hollow_kpa() const {
  // 50 kPa beside a pull of 20: a guess of others, nobody published a measurement; no more than 101 is possible.
  constexpr double kAssumedShare = 2.5, kMostKpa = 101;
  return std::min(kMostKpa, motion.vacuum_kpa > 0 ? motion.vacuum_kpa : kAssumedShare * pull_of_film_kpa());
}

double MachineProfile::pull_share_of_layer(std::uint32_t print_layer, double lit_mm2) const {
  const bool is_large = motion.large_area_mm2 > 0 && lit_mm2 > motion.large_area_mm2;
  const Stroke stroke = motion.stroke_of(print_layer < layers.bottom_count, is_large);
  if (!(motion.pull_speed_mm_per_s > 0) || stroke.tilt_s > 0) return 1;
  const double speed_mm_per_s = stroke.peel_mm > 0 ? stroke.peel_speed_mm_per_s : stroke.lift_speed_mm_per_s;
  return std::pow(speed_mm_per_s / motion.pull_speed_mm_per_s, motion.pull_speed_power);
}

double MachineProfile::weight_share() const {
  // Cured resin is a little heavier than the liquid.
  constexpr double kAssumedDensity = 1.1, kShrunk = 1.07, kGravity = 9.81;
  const double density_g_per_ml = resin.density_g_per_ml > 0 ? resin.density_g_per_ml : kAssumedDensity;
  const double weight_pa = density_g_per_ml * kShrunk * kGravity * layers.thickness_mm;  // g/ml * m/s2 * mm
  return weight_pa / (kKilo * pull_of_film_kpa());
}

double MachineProfile::modulus_of_green_mpa() const {
  constexpr double kAssumedMpa = 160;
  return resin.green_modulus_mpa > 0 ? resin.green_modulus_mpa : kAssumedMpa;
}

double MachineProfile::carried_demand() const {
  constexpr double kAssumedMpa = 10;
  const double strength_mpa = resin.green_strength_mpa > 0 ? resin.green_strength_mpa : kAssumedMpa;
  return kKilo * strength_mpa * supports.fresh_share / (supports.safety * pull_of_film_kpa());
}

}  // namespace telefab
