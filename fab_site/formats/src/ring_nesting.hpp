// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <cstdint>
#include <optional>
#include <telefab/base/result.hpp>
#include <telefab/geometry/contour.hpp>
#include <vector>

namespace telefab::fab {

/// How the rings of one layer lie to one another, decided exactly on whole nanometres.
struct RingOrder {
  /// Where two edges cross by more than a micrometre, the lowest such place; then nothing below is meant.
  std::optional<Point2> crossing;
  bool touches = false;              ///< edges meet without crossing, or lie on one another; depths are not meant then
  std::vector<std::uint32_t> depth;  ///< of each ring: how many others surround it
};

/// Rings of at least three vertices below kMaxCoordinateMm. Fails with TooLarge where the layer is so tangled that the
/// search would take more than some 10^9 comparisons.
/// Cost: about linear in edges for contours of parts.
[[nodiscard]] Result<RingOrder> order_rings(const std::vector<std::vector<Point2>>& rings);

}  // namespace telefab::fab
