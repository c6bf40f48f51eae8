// SPDX-License-Identifier: GPL-3.0-or-later
#include "coverage.hpp"

#include <algorithm>
#include <cmath>
#include <telefab/scan/contour/reeb_marcher.hpp>

namespace telefab::scan {
namespace {

/// A sample farther than this from the surface below it is not explained by it: kernel widths, and noises beside.
constexpr double kExplainedKernels = 0.25;
constexpr double kExplainedNoises = 4;
/// But never farther than this.
constexpr double kFarthestKernels = 1;
/// Sine of the slope below which the surface counts as level: 17 degrees.
constexpr double kLevelSlope = 0.3;
constexpr double kStepKernels = 0.2;
constexpr int kMostSteps = 40;
/// Where the surface arrives at the plane its contour passes, but for the chords and the steps taken.
constexpr double kArrivedKernels = 0.25;

struct OnSurface {
  Vec3 point;
  Vec3 normal;
};

/// Newton along the gradient; none where no surface is near.
std::optional<OnSurface> set_down(FieldCursor& cursor, const Vec3& start, double width, double limit) {
  Vec3 p = start;
  for (int i = 0; i < 8; ++i) {
    const FieldSample f = cursor.at(p);
    const double steep2 = f.gradient.squaredNorm();
    if (!f.in_reach || !(steep2 > 0.01) || (p - start).norm() > limit) return std::nullopt;
    if (std::abs(f.value_mm) < 0.01 * width) return OnSurface{p, f.gradient / std::sqrt(steep2)};
    p -= f.value_mm / steep2 * f.gradient;
  }
  return std::nullopt;
}

/// Up or down the steepest line to the plane; none where the surface levels out or is lost.
std::optional<OnSurface> follow_to_plane(FieldCursor& cursor, OnSurface at, double z_mm, double width) {
  for (int i = 0; i < kMostSteps; ++i) {
    const double rise = z_mm - at.point.z();
    if (std::abs(rise) < 0.01 * width) return at;
    const Vec3 up = Vec3::UnitZ() - at.normal.z() * at.normal;
    const double slope = up.norm();
    if (slope < kLevelSlope) return std::nullopt;
    const double way = std::clamp(rise / slope, -kStepKernels * width, kStepKernels * width);
    const auto next = set_down(cursor, at.point + way / slope * up, width, kStepKernels * width);
    if (!next) return std::nullopt;
    at = *next;
  }
  return std::nullopt;
}

}  // namespace

Coverage coverage_of(const ScalarField& field, FieldCursor& cursor, double z_mm, std::span<const Contour> contours,
                     const SurfaceSamples& samples, double reach_kernels, double noise_mm) {
  Coverage coverage;
  SurfaceSamples arrived;
  const auto place_of = [](const Vec3& p) { return Point2{p.x(), p.y()}; };
  for (const std::size_t i :
       uncovered_samples(field, z_mm, contours, {samples.points, samples.normals}, reach_kernels)) {
    const Vec3& sample = samples.points[i];
    const double width = field.kernel_width_mm(sample);
    const double most = std::min(kFarthestKernels * width, kExplainedKernels * width + kExplainedNoises * noise_mm);
    const auto on = set_down(cursor, sample, width, most);
    if (!on) {
      // Nobody measured it: it vouches for nothing.
      if (!samples.in_gap.empty() && samples.in_gap[i] != 0) continue;
      ++coverage.unexplained;
      coverage.places.push_back(place_of(sample));
    } else if (const auto there = follow_to_plane(cursor, *on, z_mm, width)) {
      arrived.points.push_back(there->point);
      arrived.normals.push_back(there->normal);
    }
  }
  const auto lost = uncovered_samples(field, z_mm, contours, {arrived.points, arrived.normals}, kArrivedKernels);
  coverage.lost = lost.size();
  std::vector<Point2> places;
  for (const std::size_t i : lost) places.push_back(place_of(arrived.points[i]));
  coverage.places.insert(coverage.places.begin(), places.begin(), places.end());
  return coverage;
}

bool straddles(const ScalarField& field, FieldCursor& cursor, double z_mm, const SurfaceSamples& samples) {
  bool below = false, above = false;
  for (const Vec3& sample : samples.points) {
    const double width = field.kernel_width_mm(sample);
    if (const auto on = set_down(cursor, sample, width, kFarthestKernels * width))
      (on->point.z() < z_mm ? below : above) = true;
    if (below && above) return true;
  }
  return false;
}

}  // namespace telefab::scan
