// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <functional>
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

/// Reads a text of such lines: `take` gets the layers one after the other, and ends it where it refuses one. Fails as
/// layer_from_json_line and `take` do; the message begins with "line N".
[[nodiscard]] Result<void> read_json_lines(std::string_view text, const std::function<Result<void>(Layer)>& take);

}  // namespace telefab
