// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <functional>
#include <span>
#include <telefab/geometry/layer.hpp>
#include <telefab/image/png.hpp>
#include <vector>

namespace telefab::fab {

/// One layer of a print as it is looked at. Views live as long as the call that they are handed to.
struct ViewedLayer {
  double z_mm = 0;                    ///< its middle above the platform
  std::span<const Contour> part;      ///< build frame
  std::span<const Contour> supports;  ///< build frame; may overlap each other and the part
};
/// Hands over a layer of the print to `look`. Fails where it cannot be had.
using LayerViewer = std::function<Result<void>(LayerIndex layer, const std::function<void(const ViewedLayer&)>& look)>;

/// A picture of a print as it stands on its platform, by which people know it again: the part light, supports amber,
/// shaded, from the front, somewhat from the right and from above, as the preview of a slicing. RGB, kViewWidth_px x
/// kViewHeight_px, on white; nothing but white where no layer holds anything. At most some 400 of the layers are
/// looked at, rising, each twice. Fails as the viewer does.
[[nodiscard]] Result<Image> draw_print(LayerIndex layers, const LayerViewer& viewer);
constexpr std::uint32_t kViewWidth_px = 400, kViewHeight_px = 300;

}  // namespace telefab::fab
