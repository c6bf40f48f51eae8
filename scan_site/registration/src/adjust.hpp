// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <telefab/scan/registration/register_views.hpp>

namespace telefab::scan {

struct Link {
  std::size_t from = 0, to = 0;  ///< indices of the views; from's points are matched to to's surface
};

struct AdjustOptions {
  double first_reach = 0;  ///< > 0; pairs farther apart are rejected at the start
  double last_reach = 0;   ///< > 0
  int max_rounds = 30;
  std::size_t samples = 3000;
};

/// All poses at once: minimises the point-to-plane offsets over every link in both directions; the first pose stays.
/// Returns the matches of the last round, one list a link, for the figures. Fails: NotConverged, Cancelled.
[[nodiscard]] Result<std::vector<std::vector<Match>>> adjust_all(
    std::span<const RangeImage> views, std::span<const AlignTarget> targets, std::span<const Link> links,
    const AdjustOptions& options, std::vector<RigidMotion>& poses, const std::stop_token& stop);

/// Share of points that, at these poses, stand clearly in front of what another view saw in their direction: that view
/// saw through them, so one of the poses is wrong. Views without a parallel projection are not judged; nothing if no
/// view can judge.
[[nodiscard]] std::optional<double> conflict_share(std::span<const RangeImage> views,
                                                   std::span<const RigidMotion> poses, double clearance);

}  // namespace telefab::scan
