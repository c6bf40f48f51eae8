// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <span>
#include <telefab/fab/print/print_plan.hpp>
#include <vector>

namespace telefab::fab {

/// What the time of a print depends on beside its plan.
struct StagePace {
  double top_mm = 0;           ///< where homing ends
  double homing_mm_per_s = 0;  ///< > 0
};

/// The stage of a machine as its profile states it: its top is one lift above the tallest part.
[[nodiscard]] StagePace stage_pace(const MachineProfile& machine);

/// From the end of the exposure below to the start of this layer's: waits, tilt, lift, lowering, settling. Uploads hide
/// in it. For the lowest layer, from rest one lift above its height. Layers without light are passed.
[[nodiscard]] Nanoseconds approach_time(const PrintPlan& plan, LayerIndex layer);

/// Of each layer its approach and its exposure; nothing for one that is passed without light.
[[nodiscard]] std::vector<Nanoseconds> layer_times(const PrintPlan& plan);

/// What is left of a print when each of its layers is next, and nothing behind the last: layers, and the raising of the
/// part. Uploads are taken to hide.
[[nodiscard]] std::vector<Nanoseconds> time_left(const PrintPlan& plan, const StagePace& pace);

/// Nominal time of a plan from layer `from`: homing, per layer the longer of upload and approach, and its exposure, and
/// the raising of the part. `upload` is Projector::load_time per layer; empty: no time.
[[nodiscard]] Nanoseconds print_time(const PrintPlan& plan, LayerIndex from, const StagePace& pace,
                                     std::span<const Nanoseconds> upload);

}  // namespace telefab::fab
