// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <Eigen/Core>
#include <cstdint>
#include <span>
#include <stop_token>
#include <telefab/base/result.hpp>
#include <vector>

namespace telefab::scan {

/// The k nearest neighbours of every point, the plane through them and the area a point stands for.
struct SurfaceGraph {
  std::size_t k = 0;                     ///< neighbours a point, itself not counted
  std::vector<std::uint32_t> neighbour;  ///< k a point, nearest first
  std::vector<Eigen::Vector3f> normal;   ///< unit, either side
  std::vector<float> area;               ///< of the disc that reaches to the k-th neighbour, divided by k
  float spacing = 0;                     ///< median distance of near neighbours, unit of the cloud

  [[nodiscard]] std::size_t size() const { return area.size(); }
  [[nodiscard]] std::span<const std::uint32_t> neighbours_of(std::size_t i) const {
    return {neighbour.data() + i * k, k};
  }
};

/// Fails: InvalidInput (fewer than 4 points, or nearly all in one place), Cancelled.
[[nodiscard]] Result<SurfaceGraph> build_surface_graph(std::span<const Eigen::Vector3f> points, std::size_t neighbours,
                                                       const std::stop_token& stop);

}  // namespace telefab::scan
