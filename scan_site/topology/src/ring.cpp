// SPDX-License-Identifier: GPL-3.0-or-later
#include "ring.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

namespace telefab::scan::topology {
namespace {

constexpr double kTurn = 0.25;  // radians a step: sagitta of a 32nd of the step
constexpr double kTurnLimit = 0.6;
constexpr double kFirstStepKernels = 0.03;
constexpr double kLongestStepKernels = 0.6;
constexpr double kShortestStepKernels = 1e-5;
constexpr std::size_t kMaxPoints = 400'000;

struct OnPlane {
  Vec2 point;
  Vec2 tangent;  ///< unit, solid on the left
};

std::optional<OnPlane> project_with_slope(FieldCursor& cursor, Vec3 p, double h, double limit) {
  const Vec2 start = p.head<2>();
  for (int i = 0; i < 14; ++i) {
    const FieldSample f = cursor.at(p);
    const Vec2 slope = f.gradient.head<2>();
    const double steep = slope.norm();
    if (!f.in_reach || !(steep > 1e-4)) return std::nullopt;
    Vec2 step = -f.value_mm / (steep * steep) * slope;
    const double length = step.norm();
    if (length > 0.25 * h) step *= 0.25 * h / length;
    p.head<2>() += step;
    if ((p.head<2>() - start).norm() > limit) return std::nullopt;
    if (length < 2e-4 * h && (length < 1e-6 * h || std::abs(f.value_mm) < 2e-6 * h || i > 5))
      return OnPlane{p.head<2>(), Vec2{-slope.y(), slope.x()} / steep};
  }
  return std::nullopt;
}

double cross(const Vec2& a, const Vec2& b) { return a.x() * b.y() - a.y() * b.x(); }

}  // namespace

double Ring::distance_mm(const Vec2& p, double limit_mm) const {
  constexpr double far = std::numeric_limits<double>::infinity();
  if ((p.array() < low.array() - limit_mm).any() || (p.array() > high.array() + limit_mm).any()) return far;
  double best = limit_mm * limit_mm;
  bool found = false;
  for (std::size_t i = 0; i + (closed ? 0 : 1) < points.size(); ++i) {
    const Vec2& a = points[i];
    const Vec2 side = points[i + 1 == points.size() ? 0 : i + 1] - a;
    const double share = std::clamp((p - a).dot(side) / std::max(side.squaredNorm(), 1e-300), 0.0, 1.0);
    const double d = (a + share * side - p).squaredNorm();
    if (d < best) {
      best = d;
      found = true;
    }
  }
  return found ? std::sqrt(best) : far;
}

std::optional<Vec3> project_in_plane(FieldCursor& cursor, const Vec3& p, double h_mm, double limit_mm) {
  const auto on = project_with_slope(cursor, p, h_mm, limit_mm);
  if (!on) return std::nullopt;
  return Vec3{on->point.x(), on->point.y(), p.z()};
}

std::optional<Ring> trace_ring(const ScalarField& field, FieldCursor& cursor, const Vec3& start, std::stop_token stop) {
  const double z = start.z();
  double h = field.kernel_width_mm(start);
  const auto first = project_with_slope(cursor, start, h, 0.2 * h);
  if (!first) return std::nullopt;

  Ring ring;
  ring.z_mm = z;
  ring.points = {first->point};
  OnPlane here = *first;
  double step = kFirstStepKernels * h;
  double bend = 0;  // signed, 1/mm, of the step before
  while (ring.points.size() < kMaxPoints && !stop.stop_requested()) {
    if (ring.points.size() % 64 == 0) h = field.kernel_width_mm({here.point.x(), here.point.y(), z});
    step = std::min(step, kLongestStepKernels * h);
    const Vec2 left{-here.tangent.y(), here.tangent.x()};
    const Vec2 guess = here.point + step * here.tangent + 0.5 * bend * step * step * left;
    const auto next = project_with_slope(cursor, {guess.x(), guess.y(), z}, h, 0.5 * step);
    const Vec2 chord = next ? Vec2{next->point - here.point} : Vec2{0, 0};
    const double length = chord.norm();
    const double turn = next ? std::atan2(cross(here.tangent, next->tangent), here.tangent.dot(next->tangent)) : 9;
    // The chord halves the turn on an arc; where it does not, the step jumped to another branch.
    const double lean = length > 0 ? std::abs(std::atan2(cross(here.tangent, chord), here.tangent.dot(chord))) : 9;
    if (std::abs(turn) > kTurnLimit || lean > kTurnLimit || length < 0.3 * step) {
      step *= 0.4;
      bend = 0;
      if (step < kShortestStepKernels * h) break;
      continue;
    }
    // Once around: the start lies beside this step and looks the same way.
    const Vec2 to_start = first->point - here.point;
    const double along = to_start.dot(chord) / length;
    if (ring.points.size() > 3 && along > 0 && along <= length * 1.0001 &&
        std::abs(cross(chord, to_start)) / length < 0.3 * length && first->tangent.dot(here.tangent) > 0.3) {
      ring.closed = true;
      break;
    }
    ring.points.push_back(next->point);
    bend = turn / length;
    here = *next;
    step = std::min(length * std::clamp(kTurn / std::max(std::abs(turn), 1e-6), 0.4, 2.0), kLongestStepKernels * h);
  }
  double area = 0;
  ring.low = ring.high = ring.points.front();
  for (std::size_t i = 0; i < ring.points.size(); ++i) {
    const Vec2& a = ring.points[i];
    area += cross(a - first->point, ring.points[i + 1 == ring.points.size() ? 0 : i + 1] - first->point);
    ring.low = ring.low.cwiseMin(a);
    ring.high = ring.high.cwiseMax(a);
  }
  if (ring.closed) ring.signed_area_mm2 = 0.5 * area;
  return ring;
}

std::vector<Ring> distinct_rings(const ScalarField& field, FieldCursor& cursor, std::span<const Vec3> seeds,
                                 double z_mm, double same_mm, double limit_kernels, std::vector<Ring>& open,
                                 std::stop_token stop) {
  std::vector<Ring> rings;
  for (const Vec3& seed : seeds) {
    const double h = field.kernel_width_mm(seed);
    const auto on = project_in_plane(cursor, {seed.x(), seed.y(), z_mm}, h, limit_kernels * h);
    if (!on) continue;
    const auto passes = [&](const Ring& r) { return r.distance_mm(on->head<2>(), same_mm) < same_mm; };
    if (std::any_of(rings.begin(), rings.end(), passes) || std::any_of(open.begin(), open.end(), passes)) continue;
    if (auto ring = trace_ring(field, cursor, *on, stop)) (ring->closed ? rings : open).push_back(std::move(*ring));
  }
  return rings;
}

}  // namespace telefab::scan::topology
