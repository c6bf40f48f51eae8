#pragma once
#include <telefab/fab/cure/surface_points.hpp>

#include "ring_index.hpp"

namespace telefab::fab {

/// Tells points of the part from points of its supports, layer by layer from the top: a place belongs to whose contour
/// it lies in or beside, where neither is to what was there in the layer above (that is what cures through), and where
/// nothing was to the nearer of both in this layer (that is what grew).
class PointOwner {
 public:
  explicit PointOwner(PixelSize mask) : size_{mask}, owners_(std::size_t{mask.width_px} * mask.height_px, kNobody) {}
  /// One layer down.
  void descend(const RingIndex& part, const RingIndex& supports);
  /// In the layer of the last descend(), with the same rings.
  [[nodiscard]] bool is_support(PixelPlace place, const RingIndex& part, const RingIndex& supports) const;

 private:
  static constexpr std::uint8_t kPart = 0, kSupport = 1, kNobody = 2;
  void mark(const RingIndex& rings, double grown_px, std::uint8_t value);
  PixelSize size_;
  std::vector<std::uint8_t> owners_;
};

}  // namespace telefab::fab
