// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <optional>
#include <stop_token>
#include <telefab/base/progress.hpp>
#include <telefab/fab/print/print_runner.hpp>
#include <telefab/fab/verify/support_check.hpp>

namespace telefab::fab {

/// What all light together cures of one layer.
struct CuredRuns {
  LayerRuns solid;   ///< pixels that are cured down to the layer's middle
  LayerLight light;  ///< those that hang together at its top at least, and those its own exposure begins to cure
};

/// What the masks of a plan cure by the light of all layers, bottom layer first. Of the machine its optics and resin
/// are taken, exposures are the plan's. Fails: InvalidInput (light or resin cannot be modelled, masks of another size
/// than the machine's), Cancelled, and whatever `masks` fails with. Memory: the runs of all layers.
[[nodiscard]] Result<std::vector<CuredRuns>> cured_runs(const PrintPlan& plan, MaskSource& masks,
                                                        const MachineProfile& machine, const ProgressSink& progress,
                                                        const std::stop_token& stop);

struct MaskCheckOptions {
  std::uint32_t least_pixels = kLeastIslandPixels;  ///< islands of fewer are let pass
  std::optional<std::uint8_t> grey;                 ///< a pixel is solid from here on, whatever light says
  std::optional<MaskMethod> masks;  ///< of a plan that does not state its method; others state their own
};

/// Whether anything floats in the masks of a plan, by the physics its masks were made for: the light of all layers
/// for blend-stack, one exposure of each layer for others. Shares no code of masks and light with the planner.
/// Fails as cured_runs does, and with InvalidInput where neither plan nor options state the method, or they differ.
[[nodiscard]] Result<SupportReport> check_masks(const PrintPlan& plan, MaskSource& masks, const MachineProfile& machine,
                                                const MaskCheckOptions& options, const ProgressSink& progress,
                                                const std::stop_token& stop);

}  // namespace telefab::fab
