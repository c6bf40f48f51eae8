// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>
#include <stop_token>
#include <string>
#include <telefab/base/result.hpp>
#include <telefab/scan/cloud/point_cloud.hpp>
#include <vector>

namespace telefab::scan {

struct SurfaceGraph;

struct NormalOptions {
  int neighbours = 16;  ///< [6, 64]; points of the plane fit: more smooths noise, fewer keeps thin walls apart
  [[nodiscard]] Result<void> validate() const;
};

/// What was found out about the normals. Shares are of 1.
struct NormalReport {
  bool estimated = false;              ///< false = the cloud's own normals were judged
  std::size_t pieces = 0;              ///< parts that no near neighbours join
  std::size_t flipped_points = 0;      ///< given normals that pointed inward and were turned
  std::size_t disagreeing_points = 0;  ///< of pieces whose given normals fit the shape neither way,
  std::size_t replaced_points = 0;     ///< and those of them that got estimated ones
  double winding_agreement = 0;        ///< share of the samples asked that have the inside behind them
  bool by_winding = false;             ///< estimated normals were oriented by winding numbers, not by neighbours
  double neighbour_agreement = 0;      ///< share of neighbour pairs whose normals fit one surface side
  double outside_agreement = 0;        ///< share of points facing the outside, of those where the outside can be told
  double outside_known = 0;            ///< share of points where the outside can be told
  std::size_t uncertain_points = 0;    ///< points of patches that were turned by weak or contradicting evidence
};

struct NormalResult {
  PointCloud cloud;  ///< with one outward unit normal a point
  NormalReport report;
  std::vector<std::int8_t> outside;  ///< one a point: 1 if its normal faces the outside as a flood reaches it, -1 if
                                     ///< the inside, 0 where the flood cannot tell
};

/// Gives every point an outward normal, whatever normals the cloud has: a plane fit over the nearest neighbours,
/// oriented by patches of sure neighbours first, then patches against each other, the outside (flood of an occupancy
/// grid), the enclosed volume and nesting. Frame and unit as the cloud's; nothing moves.
/// Fails: InvalidInput (fewer than 4 points, all in one place), Cancelled.
/// Cost: O(n log n), memory about 300 bytes a point. Same bytes on any number of threads.
[[nodiscard]] Result<NormalResult> with_normals(PointCloud cloud, const NormalOptions& options, std::stop_token stop);
/// The same with the neighbours pick_object found; their plane normals are turned outward too.
[[nodiscard]] Result<NormalResult> with_normals(PointCloud cloud, std::shared_ptr<SurfaceGraph> graph,
                                                const NormalOptions& options, std::stop_token stop);

/// The 16 nearest neighbours of every point. Fails as with_normals does.
[[nodiscard]] Result<std::shared_ptr<SurfaceGraph>> surface_graph_of(const PointCloud& cloud, std::stop_token stop);

/// What neighbours tell of a surface; views into the graph.
struct SurfaceFacts {
  std::span<const float> area;                    ///< that a point stands for, unit of the cloud squared
  std::span<const Eigen::Vector3f> plane_normal;  ///< of the plane through its neighbours, either way round
  std::span<const std::uint32_t> neighbour;       ///< `neighbours` a point, nearest first
  std::size_t neighbours = 0;
  std::vector<std::uint32_t> piece;  ///< points that chains of neighbours join
  std::size_t pieces = 0;
};
[[nodiscard]] SurfaceFacts facts_of(const SurfaceGraph& graph);

/// The report as one line of JSON, in a fixed order.
[[nodiscard]] std::string to_json(const NormalReport& report);

}  // namespace telefab::scan
