// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <array>

namespace telefab {

/// From where a picture shows something that stands on a platform: parallel, x to the right, y away, z up. Unit
/// vectors in its frame.
struct Viewpoint {
  std::array<double, 3> right{}, up{}, away{};
};

/// Turned about the vertical, against the clock as seen from above, and looked at from that far above the horizon.
[[nodiscard]] Viewpoint viewpoint_from(double turned_deg, double above_deg);

/// That of every picture that shows a part in one view.
[[nodiscard]] Viewpoint usual_viewpoint();

}  // namespace telefab
