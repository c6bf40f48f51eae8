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
/// A sample with no other unexplained one within so many kernel widths is a stray: whatever was lost shows more.
constexpr double kCompanyKernels = 3;

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

/// How far a sample may lie off the surface that it is of.
double explained_mm(double width, double noise_mm) {
  return std::min(kFarthestKernels * width, kExplainedKernels * width + kExplainedNoises * noise_mm);
}

/// Those that have others on no surface beside them, among themselves or among `all`.
std::vector<Vec3> in_company(const ScalarField& field, FieldCursor& cursor, const std::vector<Vec3>& strays,
                             const SampleSource& all, double noise_mm) {
  std::vector<Vec3> kept, alone;
  double low = 0, high = 0;
  for (const Vec3& stray : strays) {
    const double reach = kCompanyKernels * field.kernel_width_mm(stray);
    const auto is_beside = [&](const Vec3& other) {
      const double away = (other - stray).norm();
      return away > 0 && away < reach;
    };
    if (std::any_of(strays.begin(), strays.end(), is_beside)) {
      kept.push_back(stray);
      continue;
    }
    low = alone.empty() ? stray.z() - reach : std::min(low, stray.z() - reach);
    high = alone.empty() ? stray.z() + reach : std::max(high, stray.z() + reach);
    alone.push_back(stray);
  }
  if (alone.empty()) return kept;
  SurfaceSamples near;
  all(low, high, near);
  for (const Vec3& stray : alone) {
    const double reach = kCompanyKernels * field.kernel_width_mm(stray);
    for (std::size_t k = 0; k < near.points.size(); ++k) {
      const Vec3& other = near.points[k];
      const double away = (other - stray).norm();
      if (away == 0 || away > reach || (!near.in_gap.empty() && near.in_gap[k] != 0)) continue;
      const double width = field.kernel_width_mm(other);
      if (set_down(cursor, other, width, explained_mm(width, noise_mm))) continue;
      kept.push_back(stray);
      break;
    }
  }
  return kept;
}

}  // namespace

Coverage coverage_of(const ScalarField& field, FieldCursor& cursor, double z_mm, std::span<const Contour> contours,
                     const SurfaceSamples& samples, double reach_kernels, double noise_mm, const SampleSource& all) {
  Coverage coverage;
  SurfaceSamples arrived;
  std::vector<Vec3> unexplained;
  const auto place_of = [](const Vec3& p) { return Point2{p.x(), p.y()}; };
  for (const std::size_t i :
       uncovered_samples(field, z_mm, contours, {samples.points, samples.normals}, reach_kernels)) {
    const Vec3& sample = samples.points[i];
    const double width = field.kernel_width_mm(sample);
    const auto on = set_down(cursor, sample, width, explained_mm(width, noise_mm));
    if (!on) {
      // Nobody measured it: it vouches for nothing.
      if (!samples.in_gap.empty() && samples.in_gap[i] != 0) continue;
      unexplained.push_back(sample);
    } else if (const auto there = follow_to_plane(cursor, *on, z_mm, width)) {
      arrived.points.push_back(there->point);
      arrived.normals.push_back(there->normal);
    }
  }
  if (all) unexplained = in_company(field, cursor, unexplained, all, noise_mm);
  coverage.unexplained = unexplained.size();
  for (const Vec3& sample : unexplained) coverage.places.push_back(place_of(sample));
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
