// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <string_view>

#include "raw_layers.hpp"

namespace telefab::fab {

/// SVG with a group a layer, its upper side in slic3r:z: paths of straight lines, and polygons. y is turned around at
/// the drawing's height. Heights are millimetres, or millionths of them as Slic3r writes. Millimetres come from width,
/// height and viewBox, or from `unit_mm`. Fails: InvalidInput with the byte and what to do (curves, transforms, shapes,
/// several layers at one height), TooLarge.
[[nodiscard]] Result<RawLayers> read_svg(std::string_view text, std::optional<double> unit_mm);

}  // namespace telefab::fab
