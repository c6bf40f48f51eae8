// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <optional>
#include <stop_token>
#include <string>
#include <telefab/base/progress.hpp>
#include <telefab/base/result.hpp>
#include <telefab/scan/registration/align.hpp>
#include <telefab/scan/registration/range_image.hpp>
#include <vector>

namespace telefab::scan {

/// A turntable: every view is turned on from the one before by the same angle about one axis.
struct TurntableAxis {
  Vec3 direction = Vec3::UnitY();  ///< unit; the turn is right-handed about it
  Vec3 point = Vec3::Zero();       ///< a point on it, the nearest to the middle of the views
};

struct RegisterOptions {
  double step_deg = 0;                 ///< (0, 180]; turn from one view to the next
  std::optional<Vec3> axis_direction;  ///< either sense; unset = x, y and z are tried and then refined
  std::vector<RigidMotion> start;      ///< poses to start from (view to world), one a view; empty = search
  double max_rms = 0;                  ///< > 0; budget: point-to-plane rms of all pairs, unit of the files
  double min_overlap = 0.08;           ///< (0, 1]; links below it do not count
  double max_conflict = 0.05;          ///< [0, 1]; share of points that stand where another view saw through
  std::size_t samples = 3000;          ///< >= 100; points of a view used in one round
  [[nodiscard]] Result<void> validate(std::size_t views) const;
};

/// What one link between two views says.
struct LinkReport {
  std::size_t from = 0, to = 0;     ///< indices of the views
  double overlap = 0;               ///< share of `from`'s points that see `to`'s surface
  double pair_rms = 0;              ///< after aligning the two alone, point to plane
  double rms = 0;                   ///< after aligning all at once
  MotionDifference pair_to_global;  ///< how far the two answers are apart
};

struct Registration {
  std::vector<RigidMotion> poses;  ///< view to the frame of view 0
  TurntableAxis axis;              ///< in the frame of view 0
  std::vector<LinkReport> links;
  double rms = 0;            ///< of all links, point to plane
  double median_offset = 0;  ///< median of |point to plane|
  MotionDifference closure;  ///< all pairwise answers one after the other, round a closed turn; 0 if not closed
  bool closed_turn = false;
  double conflict = 0;    ///< share of points that stand in front of what another view saw
  double axis_score = 0;  ///< share of sampled points that matched at the axis found
};

/// Finds the poses of range images taken on a turntable: the axis by search, every pair by ICP, then all at once by
/// one point-to-plane adjustment over all links. Turns the normals of all views when they turn out to face inward.
/// Unit of the files. Deterministic.
/// Fails: InvalidInput (fewer than two views, options), NotConverged (no axis fits, a link without overlap, rms,
/// conflict or closure above budget; the message says which and by how much), Cancelled.
[[nodiscard]] Result<Registration> register_views(std::span<RangeImage> views, const RegisterOptions& options,
                                                  const ProgressSink& progress, std::stop_token stop);

}  // namespace telefab::scan
