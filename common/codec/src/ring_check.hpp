// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <span>
#include <telefab/base/result.hpp>
#include <vector>

#include "grid.hpp"

namespace telefab::codec {

/// That no two edges of a layer touch but neighbours at their common vertex, and that outer rings (counter-clockwise)
/// and holes alternate from outside to inside. Exact, in integers.
/// Fails with ProtocolBroken and the kind of fault, TooLarge where the check would take more than some 10^8
/// comparisons. Cost: O(n log n + n w) for n edges of which w cross one horizontal line.
[[nodiscard]] Result<void> check_rings(std::span<const std::vector<GridPoint>> rings);

}  // namespace telefab::codec
