// SPDX-License-Identifier: GPL-3.0-or-later
#include <algorithm>
#include <telefab/machine/rough_print_time.hpp>

namespace telefab {
namespace {

double path_s(double part_mm, double part_speed, double all_mm, double speed) {
  if (!(speed > 0)) return 0;
  const double slow_mm = part_speed > 0 ? std::min(part_mm, all_mm) : 0;
  return (slow_mm > 0 ? slow_mm / part_speed : 0) + (all_mm - slow_mm) / speed;
}

double layer_s(const MachineProfile& machine, std::uint32_t print_layer) {
  const MachineProfile::Stroke s = machine.motion.stroke_of(print_layer < machine.layers.bottom_count, false);
  return machine.exposure_of_layer_s(print_layer) + s.wait_after_exposure_s + s.tilt_s +
         path_s(s.peel_mm, s.peel_speed_mm_per_s, s.lift_mm, s.lift_speed_mm_per_s) + s.wait_after_lift_s +
         path_s(s.approach_mm, s.approach_speed_mm_per_s, s.lift_mm, s.lower_speed_mm_per_s) + s.settle_s;
}

}  // namespace

std::chrono::duration<double> rough_print_time(const MachineProfile& machine, std::uint32_t layers, double layer_mm) {
  double total = 0;
  // Layers repeat themselves once bottom and transition are over.
  const std::uint32_t special = std::min(layers, machine.layers.bottom_count + machine.layers.transition_count + 1);
  for (std::uint32_t k = 0; k < special; ++k) total += layer_s(machine, k);
  if (layers > special) total += (layers - special) * layer_s(machine, special);
  const double top_mm = machine.platform.z_travel_mm + machine.highest_lift_mm();
  const double lower = machine.motion.lower_speed_mm_per_s;
  if (lower > 0) total += top_mm / lower;
  if (const double homing = machine.homing_mm_per_s(); homing > 0)
    total += (top_mm + std::max(0.0, top_mm - layers * layer_mm)) / homing;
  return std::chrono::duration<double>{total};
}

}  // namespace telefab
