// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <telefab/geometry/contour.hpp>
#include <vector>

namespace telefab::fab {

/// Counter-clockwise, without points on its edges; one or two points where there are no more.
[[nodiscard]] std::vector<Point2> convex_hull(std::vector<Point2> points);

}  // namespace telefab::fab
