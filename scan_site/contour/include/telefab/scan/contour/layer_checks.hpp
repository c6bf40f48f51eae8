// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <optional>
#include <span>
#include <telefab/geometry/contour.hpp>
#include <telefab/scan/mls/scalar_field.hpp>
#include <vector>

namespace telefab::scan {

/// A place where two rings, or a ring and itself, touch or cross; none for a sound layer. O(n) expected.
[[nodiscard]] std::optional<Point2> find_crossing(std::span<const Contour> rings);

/// A ring that does not nest: a hole outside of every outer ring, an outer ring directly inside another. Its first
/// vertex; none for a sound layer.
[[nodiscard]] std::optional<Point2> find_bad_nesting(std::span<const Contour> rings);

}  // namespace telefab::scan
