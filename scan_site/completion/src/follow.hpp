// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <telefab/scan/completion/complete_cloud.hpp>

#include "measured_side.hpp"

namespace telefab::scan {

/// From the rims along the continued surface, cell by cell, until samples cover it again: across wide gaps along the
/// smoothest function through their rims (gap_fields.hpp); where that does not close the gap, and across narrow ones,
/// along what all samples tell together. Fills samples, too_wide, too_many.
[[nodiscard]] Result<void> follow_surface(const MeasuredSide& measured, std::span<const Rim> rims,
                                          const RimReach& reach, float most_gap, std::size_t most_samples,
                                          Completion& completion, const ProgressSink& progress, std::stop_token stop);

}  // namespace telefab::scan
