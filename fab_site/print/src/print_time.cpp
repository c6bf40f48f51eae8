// SPDX-License-Identifier: GPL-3.0-or-later
#include <algorithm>
#include <telefab/fab/print/print_time.hpp>

namespace telefab::fab {

namespace {

Nanoseconds seconds(double s) { return Nanoseconds{static_cast<Nanoseconds::rep>(s * 1e9)}; }

bool is_lit(const PlannedLayer& layer) { return layer.exposure.count() > 0; }

double top_of_lift_mm(const PlannedLayer& layer) { return layer.z_mm + layer.motion.lift_mm; }

/// From the end of its light to rest on top of its lift; the last layer does not wait there.
Nanoseconds parting_time(const PrintPlan& plan, const PlannedLayer& layer, bool is_last) {
  const LayerMotion& m = layer.motion;
  return seconds(m.wait_after_exposure_s) + seconds(m.tilt_s) +
         path_time(layer.z_mm, lift_path(m, layer.z_mm), plan.acceleration_mm_per_s2) +
         (is_last ? Nanoseconds{} : seconds(m.wait_after_lift_s));
}

Nanoseconds lowering_time(const PrintPlan& plan, const PlannedLayer& layer, double from_mm) {
  return path_time(from_mm, lowering_path(layer.motion, layer.z_mm, from_mm), plan.acceleration_mm_per_s2) +
         seconds(layer.motion.settle_s);
}

Nanoseconds homing_time(const PrintPlan& plan, const StagePace& pace, double from_mm) {
  const StageLeg up{pace.top_mm, pace.homing_mm_per_s};
  return path_time(from_mm, {&up, 1}, plan.acceleration_mm_per_s2);
}

/// From the last layer to the top.
Nanoseconds raising_time(const PrintPlan& plan, const StagePace& pace, const PlannedLayer* last) {
  if (last == nullptr) return {};
  return parting_time(plan, *last, true) + homing_time(plan, pace, top_of_lift_mm(*last));
}

}  // namespace

StagePace stage_pace(const MachineProfile& machine) {
  return {machine.platform.z_travel_mm + machine.highest_lift_mm(), machine.homing_mm_per_s()};
}

Nanoseconds approach_time(const PrintPlan& plan, LayerIndex index) {
  const PlannedLayer& layer = plan.layers[index.count()];
  for (std::size_t k = index.count(); k-- > 0;)
    if (const PlannedLayer& below = plan.layers[k]; is_lit(below))
      return parting_time(plan, below, false) + lowering_time(plan, layer, top_of_lift_mm(below));
  return lowering_time(plan, layer, top_of_lift_mm(layer));
}

std::vector<Nanoseconds> layer_times(const PrintPlan& plan) {
  std::vector<Nanoseconds> times;
  for (const PlannedLayer& layer : plan.layers)
    times.push_back(is_lit(layer) ? approach_time(plan, layer.index) + Nanoseconds{layer.exposure} : Nanoseconds{});
  return times;
}

std::vector<Nanoseconds> time_left(const PrintPlan& plan, const StagePace& pace) {
  const std::vector<Nanoseconds> times = layer_times(plan);
  const auto last = std::find_if(plan.layers.rbegin(), plan.layers.rend(), is_lit);
  std::vector<Nanoseconds> left(plan.layers.size() + 1);
  left.back() = raising_time(plan, pace, last == plan.layers.rend() ? nullptr : &*last);
  for (std::size_t k = times.size(); k-- > 0;) left[k] = left[k + 1] + times[k];
  return left;
}

Nanoseconds print_time(const PrintPlan& plan, LayerIndex from, const StagePace& pace,
                       std::span<const Nanoseconds> upload) {
  // The platform starts at the vat and homes to the top; the lowest layer's path starts there.
  Nanoseconds total = homing_time(plan, pace, 0);
  const PlannedLayer* below = nullptr;
  for (std::size_t k = from.count(); k < plan.layers.size(); ++k) {
    const PlannedLayer& layer = plan.layers[k];
    if (!is_lit(layer)) continue;
    const Nanoseconds motion =
        below == nullptr ? lowering_time(plan, layer, pace.top_mm)
                         : parting_time(plan, *below, false) + lowering_time(plan, layer, top_of_lift_mm(*below));
    const Nanoseconds loading = k < upload.size() ? upload[k] : Nanoseconds{};
    total += std::max(motion, loading) + Nanoseconds{layer.exposure};
    below = &layer;
  }
  return total + raising_time(plan, pace, below);
}

}  // namespace telefab::fab
