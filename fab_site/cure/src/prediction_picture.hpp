// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <telefab/fab/cure/edge_error.hpp>
#include <telefab/fab/cure/surface_points.hpp>
#include <telefab/image/frame.hpp>

namespace telefab::fab {

/// Left the points shaded from usual_viewpoint(), those of `supports`, which may be among `points` too, in their
/// colour; right the contours of one layer, coloured by where the edge cures: orange beyond, blue short, half a pixel
/// at full colour. `caption` says whose picture it is; legend, scale and axes are filled in.
[[nodiscard]] Image draw_prediction(std::span<const SurfacePoint> points, std::span<const SurfacePoint> supports,
                                    std::span<const EdgeSample> samples, LayerIndex layer, const CureModel& model,
                                    PictureCaption caption);

}  // namespace telefab::fab
