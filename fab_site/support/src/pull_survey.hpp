// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <functional>
#include <optional>
#include <span>
#include <stop_token>
#include <telefab/fab/support/support_plan.hpp>

#include "pull.hpp"

namespace telefab::fab {

/// What of a part is pulled at which moment, and by which tips it can be held.
struct PullSurvey {
  /// A body of the part that hangs together by then, and what pulls on it.
  struct Moment {
    double pulled_mm2 = 0;  ///< as so much area is pulled
    Point2 middle;
    std::vector<std::uint32_t> anchors;  ///< that hold the body, by index
    std::vector<std::uint32_t> sites;    ///< that could, by index
  };
  std::vector<PinSite> sites;
  std::vector<Moment> moments;  ///< bottom first; bodies that stand on the platform are none
};

struct PullSurveyOptions {
  double cell_mm = 0;        ///< > 0; cells of the model are no smaller
  double site_pitch_mm = 0;  ///< > 0; sites lie no nearer to each other
  double least_mm2 = 0;      ///< what is pulled less is left out
  double weight_share = 0;   ///< >= 0; weight of a layer over the pull on as much area
  double vacuum_share = 0;   ///< >= 0; vacuum under the opening of a closed hollow, over the pull
  double doubled_at_mm = 0;  ///< >= 0; area over perimeter of what is pulled twice as hard; 0: by area alone
  bool stands = false;       ///< the first layer stands on the platform
  /// Pull on a layer of that area, over the pull on others; none: 1.
  std::function<double(LayerIndex, double area_mm2)> pull_share;
  /// The widest tip that can be put there, if any. Asked from several threads at once.
  std::function<std::optional<TipClass>(Point2, LayerIndex)> widest_at;
  /// The sites of an earlier survey of the same layers by the same options: then `widest_at` is not asked. None: looked
  /// for.
  const std::vector<PinSite>* known_sites = nullptr;
};

/// The bodies of a part as it grows, on coarse cells. Fails with Cancelled.
[[nodiscard]] Result<PullSurvey> survey_pull(std::span<const Region> layers, std::span<const Anchor> anchors,
                                             const PullSurveyOptions& options, const std::stop_token& stop);

}  // namespace telefab::fab
