// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <chrono>
#include <cstdint>
#include <telefab/machine/machine_profile.hpp>

namespace telefab {

/// Time of a print of so many layers before anything is planned: by the profile's exposures and motion, the platform's
/// way down and up included. Axes are taken as at once, no layer as large; the fab's plan has the true figure.
[[nodiscard]] std::chrono::duration<double> rough_print_time(const MachineProfile& machine, std::uint32_t layers,
                                                             double layer_mm);

}  // namespace telefab
