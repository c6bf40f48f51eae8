#pragma once
#include <telefab/fab/cure/surface_points.hpp>

#include "ring_index.hpp"

namespace telefab::fab {

/// Tells points of the part from points of its supports, layer by layer from the top: a place belongs to whose contour
/// it lies in or beside, and where neither is, to what was there in the layer above (that is what cures through).
class PointOwner {
 public:
  explicit PointOwner(PixelSize mask) : size_{mask}, supports_(std::size_t{mask.width_px} * mask.height_px, 0) {}
  /// One layer down.
  void descend(const RingIndex& part, const RingIndex& supports);
  [[nodiscard]] bool is_support(PixelPlace place) const;

 private:
  void mark(const RingIndex& rings, double grown_px, std::uint8_t value);
  PixelSize size_;
  std::vector<std::uint8_t> supports_;
};

}  // namespace telefab::fab
