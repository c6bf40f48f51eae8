// SPDX-License-Identifier: GPL-3.0-or-later
#include <telefab/scan/cloud/ground.hpp>

#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>

#include "pieces.hpp"

namespace telefab::scan {
namespace {

constexpr std::size_t kAsked = 2000;    ///< points that vote
constexpr std::size_t kTried = 200;     ///< planes tried: those of so many of them
constexpr double kThickSpacings = 2;    ///< a plane's points lie this near to it
constexpr double kSameNormal = 0.95;    ///< cosine
constexpr double kLeastShare = 0.15;    ///< a ground holds this share of the points,
constexpr double kMostBehind = 0.01;    ///< of the others no more than this lie behind it,
constexpr double kMostFootprint = 0.5;  ///< and their footprint is no more than this part of its own

using Points = std::vector<Eigen::Vector3d>;

/// Sides of the rectangle along u and v that holds nearly all of the points.
double footprint_of(const Points& points, const Eigen::Vector3d& u, const Eigen::Vector3d& v) {
  double area = 1;
  for (const Eigen::Vector3d& axis : {u, v}) {
    std::vector<double> along;
    for (const Eigen::Vector3d& p : points) along.push_back(p.dot(axis));
    std::sort(along.begin(), along.end());
    const std::size_t cut = along.size() / 100;
    area *= along[along.size() - 1 - cut] - along[cut];
  }
  return area;
}

}  // namespace

std::optional<GroundPlane> find_ground(std::span<const Eigen::Vector3f> points, const SurfaceGraph& graph) {
  Points asked, normals;
  const std::size_t stride = points.size() / kAsked + 1;
  for (std::size_t i = 0; i < points.size(); i += stride) {
    asked.push_back(points[i].cast<double>());
    normals.push_back(graph.normal[i].cast<double>());
  }
  GroundPlane best;
  best.thickness = kThickSpacings * static_cast<double>(graph.spacing);
  std::size_t most = 0;
  for (std::size_t c = 0; c < asked.size(); c += asked.size() / kTried + 1) {
    std::size_t votes = 0;
    for (std::size_t i = 0; i < asked.size(); ++i)
      votes += std::abs((asked[i] - asked[c]).dot(normals[c])) < best.thickness &&
                       std::abs(normals[i].dot(normals[c])) > kSameNormal
                   ? 1
                   : 0;
    if (votes <= most) continue;
    most = votes;
    best.place = asked[c];
    best.up = normals[c];
  }
  best.share = static_cast<double>(most) / static_cast<double>(asked.size());
  if (best.share < kLeastShare) return std::nullopt;

  Points on, off;
  std::size_t above = 0;
  for (const Eigen::Vector3d& p : asked) {
    const double height = (p - best.place).dot(best.up);
    (std::abs(height) < 1.5 * best.thickness ? on : off).push_back(p);
    above += height >= 1.5 * best.thickness ? 1 : 0;
  }
  if (off.size() * 50 < asked.size()) return std::nullopt;  // a sheet with nothing on it
  if (2 * above < off.size()) {
    best.up = -best.up;
    above = off.size() - above;
  }
  if (static_cast<double>(off.size() - above) > kMostBehind * static_cast<double>(off.size())) return std::nullopt;
  const Eigen::Vector3d u = best.up.unitOrthogonal(), v = best.up.cross(u);
  if (footprint_of(off, u, v) > kMostFootprint * footprint_of(on, u, v)) return std::nullopt;
  return best;
}

std::optional<GroundPlane> find_ground(std::span<const Eigen::Vector3f> points, std::stop_token stop) {
  constexpr std::size_t kNeighbours = 16;
  const auto graph = build_surface_graph(points, kNeighbours, stop);
  if (!graph) return std::nullopt;
  return find_ground(points, *graph);
}

}  // namespace telefab::scan
