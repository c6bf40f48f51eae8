// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <optional>
#include <string>
#include <telefab/machine/machine_profile.hpp>

namespace telefab {

/// What no layer could be moved by: whatever layer it is, it has a lift or a tilt, and its parts lie within the lift
/// and have a speed. Names the keys. Nothing where all is well.
[[nodiscard]] std::optional<std::string> misfit_of(const MachineProfile::Motion& motion);

}  // namespace telefab
