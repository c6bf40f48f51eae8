// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <optional>
#include <telefab/command_line/options.hpp>
#include <telefab/fab/planning/plan_job.hpp>

namespace telefab::fab {

/// What may be missing of a scan before its job is held, as `plan` and `serve` are told.
struct ContourLimitOptions {
  std::optional<double> completed_percent, doubtful_percent;  ///< of the contours' length
  std::optional<double> gap_mm, error_mm;
  [[nodiscard]] ContourLimits limits() const;
};

/// `options` must outlive the parsing.
void declare_contour_limits(VerbOptions& app, ContourLimitOptions& options);

}  // namespace telefab::fab
