// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <span>

#include "raw_layers.hpp"

namespace telefab::fab {

/// The slices of every object that the build places, moved as its item says. Supports become part 2, everything else
/// part 1 and from 3 on. Slice stacks may lie in other parts of the package.
/// Fails: InvalidInput (no slices, components, an item that leans, indices out of range), TooLarge.
[[nodiscard]] Result<RawLayers> read_threemf(std::span<const std::byte> bytes, std::optional<double> unit_mm);

}  // namespace telefab::fab
