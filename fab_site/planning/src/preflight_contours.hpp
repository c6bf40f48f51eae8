// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <telefab/fab/planning/preflight.hpp>

// What the preflight asks of the contours as they came: whether they are vouched for, complete, and how much of them
// the scan shows.
namespace telefab::fab {

/// Holds where layers lack contours of the object, warns where others are flagged.
[[nodiscard]] PreflightItem certificates_of(const LayerStack& stack, const PlanSummary& summary);

/// Holds where a layer without contours lies between layers that have some: what is above it hangs in the air.
[[nodiscard]] PreflightItem empty_layers_of(const LayerStack& stack, const PlanSummary& summary);

/// How much of the contours is completed or doubtful; holds where that exceeds the summary's limits.
[[nodiscard]] PreflightItem surface_of(const LayerStack& stack, const PlanSummary& summary);

}  // namespace telefab::fab
