// SPDX-License-Identifier: GPL-3.0-or-later
#include "steepest_line.hpp"

#include <algorithm>

namespace telefab::scan::topology {
namespace {

constexpr double kStepKernels = 0.25;
constexpr double kShortestKernels = 2e-3;
constexpr double kCatchKernels = 0.3;  // an extremum this near ends the line
constexpr double kStuckKernels = 1.5;  // where the slope is gone, this near will do
constexpr double kOnSurface = 1e-5;    // kernels off, of a point of a line
constexpr double kTrial = 1e-3;        // of a place that is only asked for its slope
constexpr std::size_t kMaxPoints = 100'000;

/// Newton along the gradient onto the surface, to within so many kernels.
std::optional<FieldSample> project_on_surface(FieldCursor& cursor, Vec3& p, double h,
                                              double near_kernels = kOnSurface) {
  FieldSample f = cursor.at(p);
  for (int i = 0; i < 6; ++i) {
    if (!f.in_reach) return std::nullopt;
    const double steep = f.gradient.squaredNorm();
    if (!(steep > 1e-6)) return std::nullopt;
    if (std::abs(f.value_mm) < near_kernels * h) return f;
    p -= f.value_mm / steep * f.gradient;
    f = cursor.at(p);
  }
  return std::abs(f.value_mm) < 1e-2 * h ? std::optional{f} : std::nullopt;
}

/// Unit vector of steepest ascent on the surface; its length before was the sine of the slope.
std::pair<Vec3, double> uphill(const FieldSample& f) {
  const Vec3 n = f.gradient.normalized();
  const Vec3 t = Vec3::UnitZ() - n.z() * n;
  const double slope = t.norm();
  return {slope > 1e-12 ? Vec3{t / slope} : Vec3::Zero(), slope};
}

}  // namespace

CriticalIndex::CriticalIndex(const ScalarField& field, std::span<const CriticalPoint> points) : points_{points} {
  cell_mm_ = points.empty() ? 1 : 0;
  for (const CriticalPoint& c : points)
    cell_mm_ = std::max(cell_mm_, kStuckKernels * field.kernel_width_mm(c.position_mm));
  for (std::size_t i = 0; i < points.size(); ++i) cells_[key_of(cell_of(points[i].position_mm, cell_mm_))].push_back(i);
}

SteepestLine follow_steepest(const ScalarField& field, FieldCursor& cursor, const CriticalIndex& index,
                             const Vec3& start, bool ascending, std::optional<std::size_t> leaving,
                             std::optional<double> until_z_mm) {
  const double sign = ascending ? 1 : -1;
  const CriticalKind goal = ascending ? CriticalKind::Maximum : CriticalKind::Minimum;
  const auto left = [&](const CriticalPoint& c) { return leaving && &c == &index[*leaving]; };

  SteepestLine line;
  Vec3 p = start;
  double h = field.kernel_width_mm(p);
  auto f = project_on_surface(cursor, p, h);
  if (!f) return line;
  line.path_mm.push_back(p);
  double step = kStepKernels * h;
  while (line.path_mm.size() < kMaxPoints) {
    if (until_z_mm && sign * (p.z() - *until_z_mm) >= 0) return line;
    const auto [up, slope] = uphill(*f);
    const auto beyond = [&](const CriticalPoint& c) { return sign * (c.position_mm.z() - p.z()) > 0 && !left(c); };
    const auto caught = index.nearest(p, f->gradient.z() > 0, kCatchKernels * h, [&](const CriticalPoint& c) {
      return beyond(c) && (c.kind == goal || c.plateau);
    });
    if (caught) {
      line.end = caught;
      line.path_mm.push_back(index[*caught].position_mm);
      return line;
    }
    Vec3 q = p + sign * step * up;
    auto g = project_on_surface(cursor, q, h, kTrial);
    if (g) {
      // Midpoint rule with the mean of both directions.
      const auto [up_ahead, slope_ahead] = uphill(*g);
      if (up.dot(up_ahead) > 0.5) {
        q = p + sign * step * (up + up_ahead).normalized();
        g = project_on_surface(cursor, q, h);
      } else {
        g.reset();
      }
    }
    if (!g || !(sign * (q.z() - p.z()) > 0)) {
      step *= 0.5;
      if (step > kShortestKernels * h) continue;
      // No way on: a critical point must be here, or the line is lost.
      line.end = index.nearest(p, f->gradient.z() > 0, kStuckKernels * h, [&](const CriticalPoint& c) {
        return !left(c) && std::abs(c.position_mm.z() - p.z()) < 0.2 * h;
      });
      if (line.end && sign * (index[*line.end].position_mm.z() - p.z()) > 0)
        line.path_mm.push_back(index[*line.end].position_mm);
      return line;
    }
    p = q;
    f = g;
    line.path_mm.push_back(p);
    if (line.path_mm.size() % 16 == 0) h = field.kernel_width_mm(p);
    step = std::min(1.5 * step, kStepKernels * h);
  }
  return line;
}

}  // namespace telefab::scan::topology
