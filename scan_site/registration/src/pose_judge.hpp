// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <optional>
#include <span>
#include <telefab/scan/registration/align.hpp>

#include "view_group.hpp"

namespace telefab::scan {

/// How far matched surfaces are apart.
struct SurfaceFit {
  double rms = 0;        ///< point to plane, of single matches
  double patch_rms = 0;  ///< of the means over patches: noise averages out, a surface of another shape does not
};

/// What says whether one body stands rightly against another.
struct PoseFigures {
  SurfaceFit fit;      ///< between the views of the one and of the other
  double overlap = 0;  ///< share of the smaller one's surface that lies on the larger one's
  std::optional<double>
      conflict;          ///< share of points that the other one's views saw through; unset: no view could tell
  double stiffness = 0;  ///< least eigenvalue of the fit: near 0, the one may slide on the other
};

/// Compares at this motion (b to a), every view of the one with every view of the other.
[[nodiscard]] PoseFigures figures_of(const ViewSet& set, const ViewGroup& a, const ViewGroup& b,
                                     const RigidMotion& b_to_a);

/// The same between the views of one group: what right poses of this scan leave. Unset: no two of them see the same.
[[nodiscard]] std::optional<SurfaceFit> fit_within(const ViewSet& set, const ViewGroup& group);

/// The same between one half of a view's points and the other half: white noise and the grid, but not what bends a
/// whole view.
[[nodiscard]] SurfaceFit fit_of_halves(const RangeImage& view, double spacing);

}  // namespace telefab::scan
