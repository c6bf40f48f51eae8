// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <cstdint>
#include <span>
#include <stop_token>
#include <telefab/base/result.hpp>
#include <vector>

#include "surface_graph.hpp"

namespace telefab::scan {

/// Does this pair of near points look at the same side of one surface? The normal of one is carried to the other as
/// over a circular arc (mirrored in the plane between them): right on arcs, over sharp edges and across thin walls,
/// where the plain product of the normals is not.
struct PairVote {
  float agreement = 0;   ///< -1 opposite sides .. +1 the same side
  float confidence = 0;  ///< 0 .. 1; low where the pair lies across the surface and not along it
};
[[nodiscard]] PairVote pair_vote(const Eigen::Vector3f& point_a, const Eigen::Vector3f& normal_a,
                                 const Eigen::Vector3f& point_b, const Eigen::Vector3f& normal_b);

struct Orientation {
  std::vector<bool> turned;          ///< one a point: its normal must be turned
  std::vector<std::uint32_t> piece;  ///< one a point: which connected piece
  std::size_t pieces = 0;
  std::vector<bool> outside_decides;  ///< one a piece: enough of its points see the outside
  std::size_t uncertain_points = 0;
};

/// Chooses a side for every normal of the graph. `outward_side` has, for every point, +1, -1 or 0 (unknown) as the
/// outside sees it. Fails: Cancelled.
[[nodiscard]] Result<Orientation> choose_sides(std::span<const Eigen::Vector3f> points, const SurfaceGraph& graph,
                                               std::span<const std::int8_t> outward_side, const std::stop_token& stop);

/// Points that any chain of neighbours joins, numbered 0.. in the order of their first point; `count` of them.
[[nodiscard]] std::vector<std::uint32_t> pieces_of(const SurfaceGraph& graph, std::size_t& count);

}  // namespace telefab::scan
