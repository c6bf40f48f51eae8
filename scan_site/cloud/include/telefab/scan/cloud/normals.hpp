// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <cstddef>
#include <stop_token>
#include <string>
#include <telefab/base/result.hpp>
#include <telefab/scan/cloud/point_cloud.hpp>

namespace telefab::scan {

struct NormalOptions {
  int neighbours = 16;     ///< [6, 64]; points of the plane fit: more smooths noise, fewer keeps thin walls apart
  bool keep_given = true;  ///< false = estimate and orient although the cloud has normals
  [[nodiscard]] Result<void> validate() const;
};

/// What was found out about the normals. Shares are of 1.
struct NormalReport {
  bool estimated = false;            ///< false = the cloud's own normals were checked
  std::size_t pieces = 0;            ///< parts that no near neighbours join
  std::size_t flipped_points = 0;    ///< given normals that pointed inward and were turned
  double neighbour_agreement = 0;    ///< share of neighbour pairs whose normals fit one surface side
  double outside_agreement = 0;      ///< share of points facing the outside, of those where the outside can be told
  double outside_known = 0;          ///< share of points where the outside can be told
  std::size_t uncertain_points = 0;  ///< points of patches that were turned by weak or contradicting evidence
};

struct NormalResult {
  PointCloud cloud;  ///< with one outward unit normal a point
  NormalReport report;
};

/// Gives every point an outward normal. Missing normals are estimated (plane fit over the nearest neighbours) and
/// oriented: patches of sure neighbours first, then patches against each other, the outside (flood of an occupancy
/// grid), the enclosed volume and nesting. Given normals are checked by the same evidence; pieces that point inward
/// are flipped and reported. Frame and unit as the cloud's; nothing moves.
/// Fails: InvalidInput (fewer than 4 points, all in one place), Cancelled.
/// Cost: O(n log n), memory about 300 bytes a point. Same bytes on any number of threads.
[[nodiscard]] Result<NormalResult> with_normals(PointCloud cloud, const NormalOptions& options, std::stop_token stop);

/// The report as one line of JSON, in a fixed order.
[[nodiscard]] std::string to_json(const NormalReport& report);

}  // namespace telefab::scan
