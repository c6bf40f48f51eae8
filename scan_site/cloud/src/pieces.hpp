// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <cstdint>
#include <optional>
#include <span>
#include <telefab/scan/cloud/ground.hpp>
#include <telefab/scan/cloud/pick_object.hpp>
#include <vector>

#include "surface_graph.hpp"

namespace telefab::scan {

/// Points numbered by the piece they are of; pieces in the order of their first point.
struct PieceMap {
  std::vector<std::uint32_t> of;
  std::vector<std::size_t> size;
};

/// Points scattered in space: far from their neighbours, which lie on no common plane with them.
[[nodiscard]] std::vector<bool> scattered_points(std::span<const Eigen::Vector3f> points, const SurfaceGraph& graph);

/// Joins neighbours within three local reaches (five spacings), and then what is left apart and has points enough
/// within six spacings of the whole cloud, so that the lines of a line scanner are one piece. Points marked in `apart`
/// are joined to nothing.
[[nodiscard]] PieceMap find_pieces(std::span<const Eigen::Vector3f> points, const SurfaceGraph& graph,
                                   const std::vector<bool>& apart);

/// As ground.hpp says, with the graph there is.
[[nodiscard]] std::optional<GroundPlane> find_ground(std::span<const Eigen::Vector3f> points,
                                                     const SurfaceGraph& graph);

}  // namespace telefab::scan
