// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <telefab/base/quantity.hpp>
#include <telefab/geometry/layer.hpp>

namespace telefab::fab {

/// The stack with its holes drawn larger by so much of their radius (smaller below 0), so that they have the right size
/// once printed: MachineProfile::Resin::hole_growth_mm. A hole is an inner ring of a layer. Walls between a hole and
/// the outside keep at least that width, thinner ones what they have; what lies inside a hole stays. Layers that change
/// say nothing of what their contours rest on (Unchecked). Without growth the same stack. Fails with InvalidInput for
/// rings that are no region, or a growth that is not finite.
[[nodiscard]] Result<LayerStack> with_grown_holes(const LayerStack& stack, Millimetres growth);

}  // namespace telefab::fab
