// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <telefab/fab/cure/surface_points.hpp>

#include "ring_index.hpp"

namespace telefab::fab {

/// Tells points of the part from points of its supports, layer by layer from the top: a place belongs to whose contour
/// it lies in or beside, where neither is to what was there a few layers above (that is what cures through), and where
/// nothing was to the nearer of both in this layer (that is what grew).
class PointOwner {
 public:
  explicit PointOwner(PixelSize mask) : size_{mask}, owners_(std::size_t{mask.width_px} * mask.height_px, kNobody) {}
  /// One layer down.
  void descend(const RingIndex& part, const RingIndex& supports);
  /// In the layer of the last descend(), with the same rings.
  [[nodiscard]] bool is_support(PixelPlace place, const RingIndex& part, const RingIndex& supports) const;

 private:
  /// Twice the layer, counted from the top and from 1, and one more for supports.
  static constexpr std::uint32_t kNobody = 0;
  void mark(const RingIndex& rings, double grown_px, std::uint32_t owner);
  PixelSize size_;
  std::uint32_t layer_ = 0;
  std::vector<std::uint32_t> owners_;
};

}  // namespace telefab::fab
