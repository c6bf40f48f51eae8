// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <memory>
#include <telefab/fab/planning/plan_job.hpp>

namespace telefab::fab {

/// The passes of plan_job: each makes supports, masks, and what the check says of them. What one of them has found and
/// the next would find again is kept.
class PlanPasses {
 public:
  /// The options are valid; those of the supports are what a pass is given. References must outlive this.
  PlanPasses(const LayerStack& stack, const MachineProfile& machine, const PlanOptions& options, const PlanSink& sink,
             const Clock& clock, const ProgressSink& progress, std::stop_token stop);
  ~PlanPasses();
  PlanPasses(const PlanPasses&) = delete;
  PlanPasses& operator=(const PlanPasses&) = delete;

  /// One pass; passes differ in `floating` and `bearing` alone. Fails like plan_job.
  [[nodiscard]] Result<PlanSummary> plan(const SupportOptions& supports);
  /// The passes to come repair the last one, or fall back to it: its masks are kept for where nothing changes.
  void repair_last();

 private:
  struct State;
  std::unique_ptr<State> state_;
};

}  // namespace telefab::fab
