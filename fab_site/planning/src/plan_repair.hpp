// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <telefab/fab/planning/plan_job.hpp>

// What the judges of a plan's masks found, as orders to the planner of supports, which knows neither masks nor judges.
namespace telefab::fab {

/// How far a plan is from one that needs no repair; less is better.
struct PlanFaults {
  std::size_t islands = 0;
  double overload = 0;  ///< worst demand over what the profile allows, as far as it is above 1; of what holds much

  [[nodiscard]] bool none() const { return islands == 0 && overload == 0; }
};
[[nodiscard]] PlanFaults faults_of(const PlanSummary& planned, const MachineProfile& machine);

/// Adds the places of islands in the part's layers, as far as they are not known; false where none is new.
[[nodiscard]] bool hold_islands(const PlanSummary& planned, double pitch_mm, SupportOptions& supports);

/// Keeps all anchors of the plan, and lets those whose pins were found too weak count for less, so that others are
/// planned beside them. False where no weak place is a pin's: then the supports cannot help.
[[nodiscard]] bool relieve_pins(const PlanSummary& planned, const MachineProfile& machine, SupportOptions& supports);

}  // namespace telefab::fab
