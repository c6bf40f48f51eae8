// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <telefab/scan/registration/register_views.hpp>

namespace telefab::scan {

/// The motion that carries a view into the frame of the view before it.
[[nodiscard]] RigidMotion step_motion(const TurntableAxis& axis, double step_rad);

struct AxisFit {
  TurntableAxis axis;
  double score = 0;  ///< share of sampled points that find a fitting point in the view before
};

/// Searches position, direction (unless given) and sense of the axis, then refines them over all neighbouring views
/// at once. Fails: NotConverged, Cancelled.
[[nodiscard]] Result<AxisFit> find_axis(std::span<const RangeImage> views, std::span<const AlignTarget> targets,
                                        bool closed_turn, const RegisterOptions& options, const std::stop_token& stop);

}  // namespace telefab::scan
