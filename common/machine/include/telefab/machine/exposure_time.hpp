// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <telefab/machine/machine_profile.hpp>

namespace telefab {

/// The exposure nearest to `seconds` > 0 that the light of the machine can be timed to: whole steps
/// (MachineProfile::exposure_step_s) and at least one; `seconds` itself where it is timed to a microsecond.
[[nodiscard]] double timed_exposure_s(const MachineProfile& machine, double seconds);

}  // namespace telefab
