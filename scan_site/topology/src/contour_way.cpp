// SPDX-License-Identifier: GPL-3.0-or-later
#include "contour_way.hpp"

#include <algorithm>
#include <array>

#include "reeb_nodes.hpp"

namespace telefab::scan::topology {
namespace {

/// The contour is traced this far before the loss, in kernel widths: at the loss itself it may be level.
constexpr double kBackKernels = 0.1;
/// A line from elsewhere must leave the loss this far behind.
constexpr double kBeyondKernels = 0.5;
/// Starts nearer to the loss than this would be lost with it.
constexpr double kElsewhereKernels = 1;
/// Where on the contour, as parts of its points: across from the loss first.
constexpr std::array kElsewhere{0.5, 0.25, 0.75, 0.125, 0.375, 0.625, 0.875};
constexpr std::size_t kMostLosses = 16;

}  // namespace

bool go_on_elsewhere(const ScalarField& field, FieldCursor& cursor, const CriticalIndex& index, bool ascending,
                     ContourWay& way, std::stop_token stop) {
  if (way.end || way.path_mm.empty() || way.losses_mm.size() == kMostLosses) return false;
  const double sign = ascending ? 1 : -1;
  const Vec3 loss = way.path_mm.back();
  const double h = field.kernel_width_mm(loss);
  const Vec3 before = point_at_height(way.path_mm, loss.z() - sign * kBackKernels * h).value_or(way.path_mm.front());
  const auto ring = trace_ring(field, cursor, before, stop);
  // Of one that did not close, at the loss perhaps, the points lie on the contour nevertheless.
  if (!ring) return false;
  for (const double share : kElsewhere) {
    if (stop.stop_requested()) return false;
    const Vec2& start = ring->points[static_cast<std::size_t>(share * static_cast<double>(ring->points.size()))];
    if ((start - loss.head<2>()).norm() < kElsewhereKernels * h) continue;
    SteepestLine line =
        follow_steepest(field, cursor, index, {start.x(), start.y(), ring->z_mm}, ascending, std::nullopt);
    // The contour reaches the loss at least: an end before it is not the contour's own.
    const double beyond_mm = line.path_mm.empty() ? 0 : sign * (line.path_mm.back().z() - loss.z());
    if (!(beyond_mm > (line.end ? 0 : kBeyondKernels * h))) continue;
    std::erase_if(way.path_mm, [&](const Vec3& p) { return sign * (p.z() - line.path_mm.front().z()) >= 0; });
    way.path_mm.insert(way.path_mm.end(), line.path_mm.begin(), line.path_mm.end());
    way.end = line.end;
    way.losses_mm.push_back(loss);
    return true;
  }
  return false;
}

}  // namespace telefab::scan::topology
