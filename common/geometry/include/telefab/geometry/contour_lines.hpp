// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <string>
#include <string_view>
#include <telefab/geometry/layer.hpp>

namespace telefab {

/// One layer as one line of JSON without the newline:
///   {"layer":0,"z_mm":0.075,"contours":[[[x,y],...],...]}
/// Millimetres, build frame, outer rings counter-clockwise, holes clockwise, last vertex not repeated, shortest
/// decimals that read back to the same double.
[[nodiscard]] std::string to_json_line(const Layer& layer);

/// Reads such a line. The certificate comes back Unchecked. Fails with InvalidInput; limits of limits.hpp.
[[nodiscard]] Result<Layer> layer_from_json_line(std::string_view line);

}  // namespace telefab
