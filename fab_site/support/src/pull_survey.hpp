// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <functional>
#include <optional>
#include <span>
#include <stop_token>
#include <telefab/fab/support/support_plan.hpp>

namespace telefab::fab {

/// What of a part is pulled at which moment, and by which tips it can be held.
struct PullSurvey {
  /// An underside that can take a pin from the platform.
  struct Site {
    Point2 place;
    LayerIndex layer;
    TipClass widest = TipClass::Light;
  };
  /// A body of the part that hangs together by then, and what of it is in the layer just exposed.
  struct Moment {
    double pulled_mm2 = 0;
    Point2 middle;
    std::vector<std::uint32_t> anchors;  ///< that hold the body, by index
    std::vector<std::uint32_t> sites;    ///< that could, by index
  };
  std::vector<Site> sites;
  std::vector<Moment> moments;  ///< bottom first; bodies that stand on the platform are none
};

struct PullSurveyOptions {
  double cell_mm = 0;        ///< > 0; cells of the model are no smaller
  double site_pitch_mm = 0;  ///< > 0; sites lie no nearer to each other
  double least_mm2 = 0;      ///< what is pulled less is left out
  bool stands = false;       ///< the first layer stands on the platform
  /// The widest tip that can be put there, if any.
  std::function<std::optional<TipClass>(Point2, LayerIndex)> widest_at;
};

/// The bodies of a part as it grows, on coarse cells. Fails with Cancelled.
[[nodiscard]] Result<PullSurvey> survey_pull(std::span<const Region> layers, std::span<const Anchor> anchors,
                                             const PullSurveyOptions& options, const std::stop_token& stop);

}  // namespace telefab::fab
