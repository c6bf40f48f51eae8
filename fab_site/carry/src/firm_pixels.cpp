// SPDX-License-Identifier: GPL-3.0-or-later
#include <telefab/fab/carry/carry_watch.hpp>

namespace telefab::fab {
namespace {

constexpr std::uint8_t kHalf = 128;

}  // namespace

LayerRuns firm_pixels(const MaskView& mask, const LayerRuns& solid) {
  const PixelRuns all = solid.rows();
  const PixelRuns lit = common(LayerRuns::from_mask(mask, kHalf).rows(), all);
  return LayerRuns::from_rows(united(lit, shrunk(all, 1)), solid.size());
}

}  // namespace telefab::fab
