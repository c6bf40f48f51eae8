// SPDX-License-Identifier: GPL-3.0-or-later
#include "table.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <telefab/scan/cloud/ground.hpp>

#include "coarse_pose.hpp"

namespace telefab::scan {
namespace {

constexpr double kFilletShare = 1.5;    ///< thicknesses above the plane that go with it: its noise and the seam
constexpr double kSeenFromAbove = 0.8;  ///< share of the plane's points whose normals face up

template <class Keep>
std::size_t keep_where(std::span<RangeImage> views, std::span<const RigidMotion> poses, Keep keep) {
  std::size_t removed = 0;
  for (std::size_t v = 0; v < views.size(); ++v) {
    std::vector<bool> stays(views[v].points.size());
    for (std::size_t i = 0; i < stays.size(); ++i) stays[i] = keep(poses[v] * views[v].points[i].cast<double>());
    removed += static_cast<std::size_t>(std::ranges::count(stays, false));
    keep_points(views[v], stays);
  }
  return removed;
}

}  // namespace

std::optional<Table> remove_table(std::span<RangeImage> views, const std::stop_token& stop) {
  double spacing = 0;
  OrientedPoints all;
  for (const RangeImage& v : views) {
    spacing = std::max(spacing, static_cast<double>(v.spacing));
    all.points.insert(all.points.end(), v.points.begin(), v.points.end());
    all.normals.insert(all.normals.end(), v.normals.begin(), v.normals.end());
  }
  const OrientedPoints means = cell_means(all, 1.5 * spacing);
  const auto ground = find_ground(means.points, stop);
  if (!ground) return std::nullopt;
  const auto height = [&](const Vec3& p) { return (p - ground->place).dot(ground->up); };
  // An object's own underside is seen from below and its top stands on nothing: both face away from what is beside.
  // Images that do not say where the scanner stood may all be inside out; then the scanner is where no point is.
  std::size_t on = 0, facing = 0;
  for (std::size_t i = 0; i < means.points.size(); ++i) {
    if (std::abs(height(means.points[i].cast<double>())) > ground->thickness) continue;
    ++on;
    facing += means.normals[i].cast<double>().dot(ground->up) > 0 ? 1 : 0;
  }
  if (static_cast<double>(facing) < kSeenFromAbove * static_cast<double>(on)) return std::nullopt;
  const std::vector<RigidMotion> still(views.size(), RigidMotion::Identity());
  return Table{ground->up,
               keep_where(views, still, [&](const Vec3& p) { return height(p) > kFilletShare * ground->thickness; })};
}

std::size_t cut_below(std::span<RangeImage> views, const Registration& turn, const Vec3& up, double height) {
  double lowest = std::numeric_limits<double>::max();
  for (std::size_t v = 0; v < views.size(); ++v)
    for (std::size_t i = 0; i < views[v].points.size(); ++i)
      if (views[v].weight[i] > 0)
        lowest = std::min(lowest, (turn.poses[v] * views[v].points[i].cast<double>()).dot(up));
  return keep_where(views, turn.poses, [&](const Vec3& p) { return p.dot(up) > lowest + height; });
}

Vec3 up_of(const TurntableAxis& axis) { return axis.direction.y() < 0 ? Vec3{-axis.direction} : axis.direction; }

}  // namespace telefab::scan
