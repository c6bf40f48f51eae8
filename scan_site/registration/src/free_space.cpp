// SPDX-License-Identifier: GPL-3.0-or-later
#include "free_space.hpp"

#include <algorithm>
#include <cmath>

namespace telefab::scan {
namespace {

constexpr std::size_t kLeastJudged = 200;
constexpr float kLeastWeight = 0.2F;

}  // namespace

std::optional<double> FreeSpace::conflict() const {
  if (judged < kLeastJudged) return std::nullopt;
  return static_cast<double>(conflicting) / static_cast<double>(judged);
}

FreeSpace& FreeSpace::operator+=(const FreeSpace& other) {
  judged += other.judged;
  conflicting += other.conflicting;
  return *this;
}

FreeSpace judge_points(std::span<const Eigen::Vector3f> points, std::span<const float> weights, std::size_t step,
                       const RigidMotion& points_to_judge, const RangeImage& judge, double clearance) {
  FreeSpace found;
  if (!judge.projection) return found;
  const ParallelProjection& eye = *judge.projection;
  for (std::size_t k = 0; k < points.size(); k += step) {
    if (!weights.empty() && !(weights[k] > kLeastWeight)) continue;
    const Vec3 p = points_to_judge * points[k].cast<double>();
    const double row = eye.row.head<3>().dot(p) + eye.row[3], column = eye.column.head<3>().dot(p) + eye.column[3];
    if (!(row >= 1) || !(column >= 1) || row >= judge.view.rows - 2 || column >= judge.view.columns - 2) continue;
    // all cells about must have been seen, else the point may stand at a depth edge
    double nearest = -1e300;
    bool is_whole = true;
    for (int dr = -1; dr <= 1; ++dr)
      for (int dc = -1; dc <= 1; ++dc) {
        const std::int32_t cell = judge.view.at(static_cast<std::uint32_t>(std::lround(row) + dr),
                                                static_cast<std::uint32_t>(std::lround(column) + dc));
        is_whole &= cell >= 0 && judge.weight[static_cast<std::size_t>(cell)] > kLeastWeight;
        if (cell >= 0)
          nearest =
              std::max(nearest, eye.towards_scanner.dot(judge.points[static_cast<std::size_t>(cell)].cast<double>()));
      }
    if (!is_whole) continue;
    ++found.judged;
    found.conflicting += eye.towards_scanner.dot(p) > nearest + clearance ? 1 : 0;
  }
  return found;
}

}  // namespace telefab::scan
