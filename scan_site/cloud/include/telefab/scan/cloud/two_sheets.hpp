// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <cstddef>
#include <stop_token>
#include <telefab/base/result.hpp>
#include <telefab/scan/cloud/point_cloud.hpp>

namespace telefab::scan {

/// Looks in a cloud that does not say which view a point is of for places where its points lie on two sheets: about a
/// smooth surface fitted to the points of a place, their distances fall into two heaps, in most places around. Finds
/// sheets from a spacing apart where the noise is below a third of one; what is nearer looks like noise. 2,000 places
/// are asked, and all only where some of those show two sheets. The cloud needs oriented normals, or nothing is found.
/// Fills PointCloud::sheets_apart where there are such places, and says how many points lie there. Same answer on any
/// number of threads. Fails: Cancelled.
[[nodiscard]] Result<std::size_t> mark_two_sheets(PointCloud& cloud, std::stop_token stop);

}  // namespace telefab::scan
