// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <span>
#include <telefab/geometry/contour.hpp>
#include <vector>

namespace telefab::codec {

/// The coded rings of a layer with what the given ones rest on: every edge says the gravest of the edges of `given`
/// that lie beside it, so no stretch that is not measured is lost. Lengths as decoders will see them. Fails as
/// Contour::with_runs. Cost: O(n) expected where any ring has runs, nothing otherwise.
[[nodiscard]] Result<std::vector<Contour>> carry_runs(std::span<const Contour> given, std::vector<Contour> coded);

}  // namespace telefab::codec
