// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <telefab/machine/machine_profile.hpp>

namespace telefab {

/// All of the profile that decides about a plan's masks, exposures and motion, the light's current and colour included;
/// a plan is printed by no other. Not part of it: the description, the speed of virtual devices, serial numbers,
/// limits.
[[nodiscard]] Digest digest_of_light(const MachineProfile& profile);

}  // namespace telefab
