// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <array>
#include <span>
#include <string>
#include <telefab/geometry/layer.hpp>

namespace telefab::campaign {

/// A layer over the true section (segments, light blue) as SVG: measured edges black, completed ones orange, doubtful
/// ones red. To be looked at where a layer is wrong.
[[nodiscard]] std::string picture_of(const Layer& layer, std::span<const std::array<Point2, 2>> truth);

}  // namespace telefab::campaign
