// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <optional>
#include <span>
#include <telefab/scan/registration/align.hpp>

#include "view_group.hpp"

namespace telefab::scan {

/// What says whether one body stands rightly against another.
struct PoseFigures {
  double rms = 0;                  ///< point to plane between the views of the one and of the other
  double overlap = 0;              ///< share of the smaller one's surface that lies on the larger one's
  std::optional<double> conflict;  ///< share of points that the other one's views saw through; unset: no view could tell
  double stiffness = 0;            ///< least eigenvalue of the fit: near 0, the one may slide on the other
};

/// Compares at this motion (b to a), every view of the one with every view of the other.
[[nodiscard]] PoseFigures figures_of(const ViewSet& set, const ViewGroup& a, const ViewGroup& b,
                                     const RigidMotion& b_to_a);

/// Point-to-plane rms between the views of one group, as `figures_of` measures it: what right poses of this scan
/// leave. Unset: no two of them see the same.
[[nodiscard]] std::optional<double> rms_within(const ViewSet& set, const ViewGroup& group);

}  // namespace telefab::scan
