// SPDX-License-Identifier: GPL-3.0-or-later
#include "surface_graph.hpp"

#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>
#include <Eigen/Eigenvalues>
#include <algorithm>
#include <numbers>
#include <telefab/scan/cloud/kd_tree.hpp>

namespace telefab::scan {
namespace {

/// The direction in which the points scatter least about their mean.
Eigen::Vector3f plane_normal(std::span<const Eigen::Vector3f> points, std::span<const Neighbour> near) {
  const Eigen::Vector3f& base = points[near[0].index];
  Eigen::Vector3d sum = Eigen::Vector3d::Zero();
  Eigen::Matrix3d square = Eigen::Matrix3d::Zero();
  for (const Neighbour& n : near) {
    const Eigen::Vector3d d = (points[n.index] - base).cast<double>();
    sum += d;
    square.noalias() += d * d.transpose();
  }
  const auto count = static_cast<double>(near.size());
  Eigen::Matrix3d scatter = square - sum * sum.transpose() / count;
  const double scale = scatter.trace();
  if (!(scale > 0)) return Eigen::Vector3f::UnitZ();
  scatter /= scale;
  Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> solver;
  solver.computeDirect(scatter);
  const Eigen::Vector3d normal = solver.eigenvectors().col(0);
  const double length = normal.norm();
  if (!(length > 0.5)) return Eigen::Vector3f::UnitZ();
  return (normal / length).cast<float>();
}

}  // namespace

Result<SurfaceGraph> build_surface_graph(std::span<const Eigen::Vector3f> points, std::size_t neighbours,
                                         const std::stop_token& stop) {
  if (points.size() < 4) return fail(ErrorCode::InvalidInput, "normals need at least 4 different points");
  const KdTree tree{points};
  SurfaceGraph graph;
  graph.k = std::min(neighbours, points.size() - 1);
  graph.neighbour.resize(points.size() * graph.k);
  graph.normal.resize(points.size());
  graph.area.resize(points.size());
  std::vector<float> near_distance(points.size());
  const auto order = tree.leaf_order();
  tbb::parallel_for(tbb::blocked_range<std::size_t>{0, points.size(), 1024}, [&](const auto& range) {
    if (stop.stop_requested()) return;
    std::vector<Neighbour> found(graph.k + 1);
    for (std::size_t r = range.begin(); r < range.end(); ++r) {
      const std::uint32_t i = order[r];
      tree.nearest(points[i], found);
      graph.normal[i] = plane_normal(points, found);
      // the point itself comes first, unless others lie in the very same place
      const auto self = std::find_if(found.begin(), found.end(), [&](const Neighbour& n) { return n.index == i; });
      if (self != found.end()) std::rotate(found.begin(), self, self + 1);
      for (std::size_t j = 0; j < graph.k; ++j) graph.neighbour[i * graph.k + j] = found[j + 1].index;
      graph.area[i] = std::numbers::pi_v<float> * found[graph.k].squared_distance / static_cast<float>(graph.k);
      near_distance[i] = found[std::min<std::size_t>(graph.k, 3)].squared_distance;
    }
  });
  if (stop.stop_requested()) return cancelled("estimating normals");
  const auto middle = near_distance.begin() + static_cast<std::ptrdiff_t>(near_distance.size() / 2);
  std::nth_element(near_distance.begin(), middle, near_distance.end());
  graph.spacing = std::sqrt(*middle);
  if (!(graph.spacing > 0))
    return fail(ErrorCode::InvalidInput, "more than half of the points lie in one place; clean the cloud first");
  return graph;
}

}  // namespace telefab::scan
