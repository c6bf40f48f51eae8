// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <chrono>
#include <memory>
#include <stop_token>
#include <string>
#include <string_view>
#include <telefab/base/progress.hpp>
#include <telefab/fab/print/print_plan.hpp>
#include <telefab/fab/print/print_runner.hpp>
#include <telefab/geometry/layer.hpp>
#include <vector>

namespace telefab::fab {

/// A print whose masks, times and motion another program made, to be printed as they are.
struct ReadyPrint {
  struct Layer {
    double z_mm = 0;  ///< its top above the platform
    std::chrono::microseconds exposure{0};
    LayerMotion motion;
    double light_share = 1;  ///< (0, 1]; of full light
  };
  double thickness_mm = 0;  ///< > 0; of all layers but perhaps the first
  std::string origin;       ///< for people: who made it, and what of it is the machine's own
  std::vector<Layer> layers;
  std::shared_ptr<MaskSource> masks;  ///< one a layer, of the machine's size
};

/// The grey from which a pixel of such a mask counts as solid: its maker's model of the light is not known.
constexpr std::uint8_t kReadySolid = 128;

/// What the masks show as contours, along the edges of solid pixels, smoothed within a pixel: for pictures, walls and
/// what else is asked of a part; it is not printed by. Certificates are Unchecked, Imported. `name` is for people.
/// Fails: InvalidInput (a mask of another size, no light at all), Cancelled, and as the masks do.
[[nodiscard]] Result<LayerStack> outlines_of(const ReadyPrint& print, const MachineProfile& machine,
                                             std::string_view name, const ProgressSink& progress,
                                             const std::stop_token& stop);

}  // namespace telefab::fab
