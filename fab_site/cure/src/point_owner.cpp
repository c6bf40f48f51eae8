// SPDX-License-Identifier: GPL-3.0-or-later
#include "point_owner.hpp"

#include <algorithm>
#include <cmath>

namespace telefab::fab {
namespace {

constexpr double kBeside_px = 1.5;
constexpr double kSearch_px = 30;
/// Deeper than this no print cures through.
constexpr std::uint32_t kThrough_layers = 16;

}  // namespace

void PointOwner::mark(const RingIndex& rings, double grown_px, std::uint32_t owner) {
  const PixelBox& box = rings.box();
  const int width = static_cast<int>(size_.width_px), height = static_cast<int>(size_.height_px);
  const int up = static_cast<int>(std::ceil(grown_px));  // a row may just miss the end of a ring
  for (int y = box.y; y < box.y + box.height; ++y) {
    const auto spans = rings.spans_at(y + 0.5);
    for (std::size_t i = 0; i + 1 < spans.size(); i += 2) {
      const int from = std::clamp(static_cast<int>(std::floor(spans[i] - grown_px)), 0, width);
      const int until = std::clamp(static_cast<int>(std::ceil(spans[i + 1] + grown_px)), from, width);
      for (int row = std::max(0, y - up); row <= std::min(height - 1, y + up); ++row) {
        const auto first = owners_.begin() + static_cast<std::ptrdiff_t>(row) * width;
        std::fill(first + from, first + until, owner);
      }
    }
  }
}

void PointOwner::descend(const RingIndex& part, const RingIndex& supports) {
  ++layer_;
  mark(supports, kBeside_px, 2 * layer_ + 1);
  mark(part, kBeside_px, 2 * layer_);
}

bool PointOwner::is_support(PixelPlace place, const RingIndex& part, const RingIndex& supports) const {
  const int x = std::clamp(static_cast<int>(std::floor(place.x_px)), 0, static_cast<int>(size_.width_px) - 1);
  const int y = std::clamp(static_cast<int>(std::floor(place.y_px)), 0, static_cast<int>(size_.height_px) - 1);
  const std::uint32_t owner = owners_[static_cast<std::size_t>(y) * size_.width_px + static_cast<std::size_t>(x)];
  if (owner != kNobody && layer_ - owner / 2 <= kThrough_layers) return owner % 2 == 1;
  return supports.distance(place, kSearch_px) < part.distance(place, kSearch_px);
}

}  // namespace telefab::fab
