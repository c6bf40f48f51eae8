// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <telefab/fab/planning/plan_job.hpp>

namespace telefab::fab {

/// One pass of plan_job: supports by the options, masks, and what the check says of them. The options are valid. Fails
/// like plan_job.
[[nodiscard]] Result<PlanSummary> plan_pass(const LayerStack& stack, const MachineProfile& machine,
                                            const PlanOptions& options, const PlanSink& sink, const Clock& clock,
                                            const ProgressSink& progress, std::stop_token stop);

}  // namespace telefab::fab
