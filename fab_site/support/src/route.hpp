// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <telefab/fab/support/support_plan.hpp>

namespace telefab::fab {

struct RoutedStructure {
  Structure structure;
  std::uint32_t feet_on_part = 0;
  std::uint32_t braces = 0;
  std::uint32_t thin_pins = 0;
};

/// Builds a tip, an arm where the column below is not free, a pin and a foot for every anchor; then braces and base
/// plates. `layers` are the part's regions, `elevation_layers` below them. Marks anchors whose pin stands on the part.
[[nodiscard]] RoutedStructure route_supports(std::vector<Anchor>& anchors, std::span<const Region> layers,
                                             std::uint32_t elevation_layers, double thickness_mm,
                                             const MachineProfile& machine);

}  // namespace telefab::fab
