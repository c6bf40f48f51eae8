// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <telefab/machine/machine_profile.hpp>
#include <telefab/scan/cloud/box3.hpp>

namespace telefab::scan {

/// Width, depth and height of what a machine prints, millimetres.
[[nodiscard]] Vec3 room_of(const MachineProfile& machine);

/// Millimetres a unit that make a part of this size (in its own unit, > 0) as large as the machine holds, with supports
/// and a margin of 1 % on every side. `beyond_mm`: what the part has besides, at any scale.
[[nodiscard]] double fitted_scale(const MachineProfile& machine, const Vec3& size, const Vec3& beyond_mm);

}  // namespace telefab::scan
