// SPDX-License-Identifier: GPL-3.0-or-later
#include "coarse_steps.hpp"

#include <fmt/format.h>
#include <algorithm>
#include <array>
#include <cmath>

namespace telefab::scan {
namespace {

constexpr std::size_t kAsked = 4096;        ///< points looked at; a step shows in far fewer
constexpr double kFarExtents = 50;          ///< a cloud this many of its sizes from the origin is far
constexpr double kFloatSteps = 33'554'432;  ///< 2^25: a float has at most half as many steps up to its value
constexpr double kCoarseOfFloat = 0.1;      ///< of the spacing: coarser steps harm, where a float made them
constexpr double kCoarse = 0.3;             ///< the same, whoever made them

/// Smallest distance of two different values.
double step_of(std::vector<double> values) {
  std::sort(values.begin(), values.end());
  double step = 0;
  for (std::size_t i = 1; i < values.size(); ++i)
    if (const double gap = values[i] - values[i - 1]; gap > 0 && (step == 0 || gap < step)) step = gap;
  return step;
}

}  // namespace

std::optional<CoarseSteps> coarse_steps_of(std::span<const Vec3> points) {
  if (points.size() < 4) return std::nullopt;
  Vec3 low = points[0], high = points[0];
  for (const Vec3& p : points) {
    low = low.cwiseMin(p);
    high = high.cwiseMax(p);
  }
  const Vec3 size = high - low;
  const Vec3 away = low.cwiseAbs().cwiseMax(high.cwiseAbs());
  if (away.maxCoeff() < kFarExtents * size.maxCoeff()) return std::nullopt;
  const double area = 2 * (size.x() * size.y() + size.y() * size.z() + size.z() * size.x());
  const double spacing = std::sqrt(area / static_cast<double>(points.size()));

  CoarseSteps found;
  std::string where;
  static constexpr std::array kAxes{'x', 'y', 'z'};
  const std::size_t stride = points.size() / kAsked + 1;
  for (int axis = 0; axis < 3; ++axis) {
    std::vector<double> values;
    for (std::size_t i = 0; i < points.size(); i += stride) values.push_back(points[i][axis]);
    const double step = step_of(std::move(values));
    const double least = away[axis] < kFloatSteps * step ? kCoarseOfFloat : kCoarse;
    if (away[axis] < kFarExtents * size[axis] || step <= least * spacing) continue;
    where += fmt::format("{}{:g} in {}", where.empty() ? "" : " and ", step, kAxes[static_cast<std::size_t>(axis)]);
    found.step = std::max(found.step, step);
  }
  if (where.empty()) return std::nullopt;
  found.text = fmt::format(
      "the coordinates are rounded to steps of {}, at a spacing of {:.2g} between the points: numbers as large as "
      "{:.7g} "
      "do not fit the format they were written in, and detail below the steps is lost. Move the origin near the object "
      "before writing the file, or write doubles",
      where, spacing, away.maxCoeff());
  return found;
}

}  // namespace telefab::scan
