// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <cstddef>
#include <cstdint>
#include <stop_token>
#include <string>
#include <telefab/base/result.hpp>
#include <telefab/scan/cloud/point_cloud.hpp>
#include <vector>

namespace telefab::scan {

struct CleanOptions {
  int neighbours = 16;  ///< [6, 64]; points looked at about each point
  double outlier_factor =
      3;  ///< > 1; a point whose neighbours lie this many times farther than its surroundings' is one
  double cluster_reach = 5;      ///< > 0; spacings within which points belong together
  double least_cluster = 0.002;  ///< [0, 1); share of all points below which a cluster is removed
  bool smooth = false;           ///< move points along their normal onto a quadric fitted to their neighbours
  [[nodiscard]] Result<void> validate() const;

  /// Removes what is surely wrong and moves nothing.
  [[nodiscard]] static CleanOptions careful();
  /// Removes more, and smooths.
  [[nodiscard]] static CleanOptions strong();
};

enum class PointFate : std::uint8_t { Kept, Duplicate, Outlier, SmallCluster };

struct CleanReport {
  std::size_t points_in = 0;
  std::size_t duplicates = 0;
  std::size_t outliers = 0;
  std::size_t cluster_points = 0;  ///< in clusters below least_cluster
  std::size_t clusters_removed = 0;
  double spacing = 0;     ///< median distance of near neighbours; unit of the cloud, as all lengths here
  double unevenness = 0;  ///< ratio of the spacing's 95th to its 5th percentile
  double noise = 0;       ///< sigma across the surface: residual of local quadrics, before smoothing
  double noise_after = 0;
  double moved_rms = 0;  ///< how far smoothing moved the points
  double moved_max = 0;
};

struct CleanResult {
  PointCloud cloud;             ///< order of the points kept; normals and confidence go with their points
  std::vector<PointFate> fate;  ///< one a point of the input
  CleanReport report;
};

/// Duplicates, outliers, small isolated clusters; noise estimate; smoothing if asked.
/// Fails: InvalidInput (options, fewer than 10 points, all removed), Cancelled. Same bytes on any number of threads.
[[nodiscard]] Result<CleanResult> clean_cloud(const PointCloud& cloud, const CleanOptions& options,
                                              std::stop_token stop);

[[nodiscard]] std::string to_json(const CleanReport& report);

}  // namespace telefab::scan
