// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include "follow.hpp"

namespace telefab::scan {

/// Moves the virtual samples onto the moving-least-squares surface of all samples, round by round; measured ones stay,
/// and so do smooth ones.
[[nodiscard]] Result<void> relax(const MeasuredSide& measured, std::vector<VirtualSample>& samples, int rounds,
                                 std::stop_token stop);

}  // namespace telefab::scan
