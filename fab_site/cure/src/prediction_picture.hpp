// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <telefab/fab/cure/edge_error.hpp>
#include <telefab/fab/cure/surface_points.hpp>
#include <telefab/image/png.hpp>

namespace telefab::fab {

/// Left the points shaded as seen from the front, above and a little to the right; right the contours of one layer,
/// coloured by where the edge cures: red beyond, blue short, half a pixel at full colour.
[[nodiscard]] Image draw_prediction(std::span<const SurfacePoint> points, std::span<const EdgeSample> samples,
                                    LayerIndex layer, const CureModel& model);

}  // namespace telefab::fab
