// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <array>
#include <cstdint>
#include <telefab/fab/region/region.hpp>
#include <vector>

namespace telefab::fab {

/// Triangles that fill a region, counter-clockwise; vertices are counted through its rings in order.
[[nodiscard]] std::vector<std::array<std::uint32_t, 3>> triangulated(const Region& region);

}  // namespace telefab::fab
