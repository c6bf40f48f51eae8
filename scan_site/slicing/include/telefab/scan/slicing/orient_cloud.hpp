// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <memory>
#include <stop_token>
#include <string>
#include <telefab/base/result.hpp>
#include <telefab/scan/cloud/normals.hpp>
#include <vector>

namespace telefab::scan {

struct OrientedCloud {
  PointCloud cloud;  ///< with one outward unit normal a point
  NormalReport report;
  std::vector<std::string> warnings;  ///< what was turned, or does not fit, for people
};

/// Outward normals for every point. Given ones are judged, piece by piece, by the winding number a spacing behind and
/// before some of them: a piece whose samples have the inside behind them is kept, one that would have it when turned
/// is turned. Where neither is sure (open scans, sharp parts with few points) normals that look like their neighbours'
/// stay or are turned as is likelier; others disagree with the shape, and estimated ones replace them if they fit
/// better. Missing ones are estimated by neighbours and, where too few of them then fit a closed shape, by winding
/// numbers. Nothing moves. Fails as with_normals does.
[[nodiscard]] Result<OrientedCloud> orient_cloud(PointCloud cloud, std::shared_ptr<SurfaceGraph> graph,
                                                 std::stop_token stop);
/// The same, which finds the neighbours itself.
[[nodiscard]] Result<OrientedCloud> orient_cloud(PointCloud cloud, std::stop_token stop);

}  // namespace telefab::scan
