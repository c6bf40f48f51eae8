// SPDX-License-Identifier: GPL-3.0-or-later
#include "pieces.hpp"

#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>
#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>
#include <telefab/base/disjoint_sets.hpp>
#include <telefab/base/median.hpp>
#include <telefab/scan/cloud/kd_tree.hpp>

namespace telefab::scan {
namespace {

constexpr std::size_t kReachRank = 7;      ///< the eighth neighbour: its distance is the reach of a point, 1.6 spacings
constexpr float kLinkReaches = 3;          ///< links are this many reaches long at most
constexpr double kLinkSpacings = 6;        ///< between pieces: spacings of the whole cloud
constexpr std::size_t kLeastJoined = 30;   ///< points of a piece, not of a clump of strays near one
constexpr std::size_t kAskedOfPiece = 64;  ///< points of a piece that look for other pieces
/// A point farther from its neighbours than so many median reaches, where those lie about it to all sides (least over
/// all of their scatter); of those twice as far it need not be so clear.
constexpr float kScatteredReaches = 3;
constexpr double kScatteredRoundness = 0.15, kFarRoundness = 0.05;

float reach_of(std::span<const Eigen::Vector3f> points, const SurfaceGraph& graph, std::uint32_t i) {
  const auto near = graph.neighbours_of(i);
  return (points[near[std::min(kReachRank, near.size() - 1)]] - points[i]).norm();
}

std::vector<float> reaches_of(std::span<const Eigen::Vector3f> points, const SurfaceGraph& graph) {
  std::vector<float> reach(points.size());
  tbb::parallel_for(tbb::blocked_range<std::uint32_t>{0, static_cast<std::uint32_t>(points.size()), 4096},
                    [&](const auto& range) {
                      for (std::uint32_t i = range.begin(); i < range.end(); ++i) reach[i] = reach_of(points, graph, i);
                    });
  return reach;
}

/// Lower quartile of the reaches about a point: those of the surface it is near, not its own.
std::vector<float> local_reaches(const SurfaceGraph& graph, std::span<const float> reach) {
  std::vector<float> local(reach.size());
  tbb::parallel_for(tbb::blocked_range<std::size_t>{0, reach.size(), 4096}, [&](const auto& range) {
    std::vector<float> around;
    for (std::size_t i = range.begin(); i < range.end(); ++i) {
      around.assign(1, reach[i]);
      for (const std::uint32_t j : graph.neighbours_of(i)) around.push_back(reach[j]);
      const auto quarter = around.begin() + static_cast<std::ptrdiff_t>(around.size() / 4);
      std::nth_element(around.begin(), quarter, around.end());
      local[i] = *quarter;
    }
  });
  return local;
}

PieceMap numbered(DisjointSets& sets) {
  PieceMap map;
  map.of = sets.numbers();
  for (const std::uint32_t piece : map.of) {
    if (piece == map.size.size()) map.size.push_back(0);
    ++map.size[piece];
  }
  return map;
}

/// Spacing of a cloud as even as this one is not: by the box that holds nearly all of it, so that no stray counts.
double spacing_by_box(std::span<const Eigen::Vector3f> points) {
  constexpr std::size_t kAsked = 4096;
  const std::size_t stride = points.size() / kAsked + 1;
  Eigen::Vector3d size;
  for (int axis = 0; axis < 3; ++axis) {
    std::vector<float> values;
    for (std::size_t i = 0; i < points.size(); i += stride) values.push_back(points[i][axis]);
    std::sort(values.begin(), values.end());
    const std::size_t cut = values.size() / 50;
    size[axis] = static_cast<double>(values[values.size() - 1 - cut]) - static_cast<double>(values[cut]);
  }
  const double area = 2 * (size.x() * size.y() + size.y() * size.z() + size.z() * size.x());
  return std::sqrt(area / static_cast<double>(points.size()));
}

/// Joins pieces whose points lie near each other although they are not among each other's nearest.
void join_near(std::span<const Eigen::Vector3f> points, const std::vector<bool>& apart, float radius,
               DisjointSets& sets) {
  const PieceMap map = numbered(sets);
  const std::size_t largest =
      static_cast<std::size_t>(std::max_element(map.size.begin(), map.size.end()) - map.size.begin());
  if (map.size[largest] == points.size()) return;
  const KdTree tree{points};
  std::vector<std::size_t> seen(map.size.size(), 0);
  for (std::uint32_t i = 0; i < points.size(); ++i) {
    const std::uint32_t p = map.of[i];
    if (apart[i] || p == largest || map.size[p] < kLeastJoined) continue;
    if (seen[p]++ % (map.size[p] / kAskedOfPiece + 1) != 0) continue;
    for (const Neighbour& n : tree.within(points[i], radius))
      if (!apart[n.index] && map.size[map.of[n.index]] >= kLeastJoined) sets.join(i, n.index);
  }
}

}  // namespace

std::vector<bool> scattered_points(std::span<const Eigen::Vector3f> points, const SurfaceGraph& graph) {
  const std::vector<float> reach = reaches_of(points, graph);
  const float far = kScatteredReaches * median_of(reach);
  std::vector<bool> scattered(points.size(), false);
  for (std::uint32_t i = 0; i < points.size(); ++i) {
    if (reach[i] <= far) continue;
    Eigen::Vector3d sum = Eigen::Vector3d::Zero();
    Eigen::Matrix3d square = Eigen::Matrix3d::Zero();
    const auto near = graph.neighbours_of(i);
    for (const std::uint32_t j : near) {
      const Eigen::Vector3d d = ((points[j] - points[i]) / reach[i]).cast<double>();
      sum += d;
      square += d * d.transpose();
    }
    const auto count = static_cast<double>(near.size() + 1);
    const Eigen::Matrix3d scatter = square - sum * sum.transpose() / count;
    const Eigen::Vector3d spread = Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d>{scatter}.eigenvalues();
    const double least = reach[i] > 2 * far ? kFarRoundness : kScatteredRoundness;
    scattered[i] = spread[0] > least * spread.sum();
  }
  return scattered;
}

PieceMap find_pieces(std::span<const Eigen::Vector3f> points, const SurfaceGraph& graph,
                     const std::vector<bool>& apart) {
  const std::vector<float> local = local_reaches(graph, reaches_of(points, graph));
  DisjointSets sets{points.size()};
  for (std::uint32_t i = 0; i < points.size(); ++i) {
    if (apart[i]) continue;
    for (const std::uint32_t j : graph.neighbours_of(i)) {
      const float longest = kLinkReaches * std::min(local[i], local[j]);
      if (!apart[j] && (points[i] - points[j]).squaredNorm() <= longest * longest) sets.join(i, j);
    }
  }
  join_near(points, apart, static_cast<float>(kLinkSpacings * spacing_by_box(points)), sets);
  return numbered(sets);
}

}  // namespace telefab::scan
