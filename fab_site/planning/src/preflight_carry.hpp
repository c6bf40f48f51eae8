// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <telefab/fab/planning/preflight.hpp>

namespace telefab::fab {

/// Whether the print carries the pull of the film in every moment. Holds where a place that holds much bears more than
/// the profile allows, and says where its figures are assumed; warns of places that hold little, and says so where
/// something could not be judged.
[[nodiscard]] PreflightItem carry_of(const MachineProfile& machine, const PlanSummary& summary);

}  // namespace telefab::fab
