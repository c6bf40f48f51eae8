// SPDX-License-Identifier: GPL-3.0-or-later
#include "contour_limit_options.hpp"

namespace telefab::fab {

ContourLimits ContourLimitOptions::limits() const {
  const auto share = [](const std::optional<double>& percent) {
    return percent ? std::optional{*percent / 100} : std::nullopt;
  };
  return {share(completed_percent), share(doubtful_percent), gap_mm, error_mm};
}

void declare_contour_limits(VerbOptions& app, ContourLimitOptions& options) {
  app.add("--most-completed", options.completed_percent,
          "hold a job of whose contours more than this percentage is completed where the scan shows nothing; default: "
          "any")
      .within(0.0, 100.0);
  app.add("--most-doubtful", options.doubtful_percent,
          "hold a job of whose contours more than this percentage is doubtful; default: any")
      .within(0.0, 100.0);
  app.add("--most-gap-mm", options.gap_mm,
          "hold a job with contours completed farther than this from the scan's samples; default: any")
      .within(0.0, 10000.0);
  app.add("--most-error-mm", options.error_mm,
          "hold a job whose completed contours may be wrong by more than this; default: any")
      .within(0.0, 10000.0);
}

}  // namespace telefab::fab
