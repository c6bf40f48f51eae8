// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <span>
#include <stop_token>
#include <telefab/base/result.hpp>
#include <telefab/scan/cloud/point_cloud.hpp>
#include <vector>

namespace telefab::scan {

/// Outward unit normals of points that lie on a closed surface, from nothing but the wish that the winding number be
/// one half at every point: where neighbours cannot tell which way a sparse, sharp surface turns, all points together
/// can. All of up to 8,000 points are solved for; of more at most 5,000, evenly chosen, and the others take after the
/// nearest of those. Method:
/// repeated gradient steps on the area-weighted normals, whose directions are then set to the gradient of the winding
/// number they make, with a softening that shrinks from one spacing to half of one (after Lin, Shi and Liu, "Fast and
/// Globally Consistent Normal Orientation based on the Winding Number Normal Consistency", 2024). `areas`: one a point.
/// Fails: Cancelled. Cost: 80 times the square of the points solved for, on all threads. Same bytes on any number of
/// threads.
[[nodiscard]] Result<std::vector<Eigen::Vector3f>> winding_normals(std::span<const Eigen::Vector3f> points,
                                                                   std::span<const float> areas, std::stop_token stop);

/// Whether every one of so many points would be solved for.
[[nodiscard]] bool winding_normals_ask_all(std::size_t points);

}  // namespace telefab::scan
