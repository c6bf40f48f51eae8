// SPDX-License-Identifier: GPL-3.0-or-later
#include "ring.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <telefab/scan/section/follow_arc.hpp>

namespace telefab::scan::topology {
namespace {

constexpr double kTurn = 0.25;  // radians a step
constexpr double kTurnLimit = 0.6;
constexpr double kFirstStepKernels = 0.03;
constexpr double kLongestStepKernels = 0.6;
constexpr double kShortestStepKernels = 1e-5;
constexpr std::size_t kMaxPoints = 400'000;

std::optional<PlaneSample> project_closely(PlaneCursor& plane, const Vec2& from, double h, double most_move_mm) {
  return plane.project(
      {from.x(), from.y()}, {0.25 * h, most_move_mm, 1e-4, 14}, [&](const PlaneSample& s, double length, int steps) {
        const bool arrives = length < 2e-4 * h && (length < 1e-6 * h || std::abs(s.value_mm) < 2e-6 * h || steps > 5);
        return arrives ? Arrival::AfterStep : Arrival::GoOn;
      });
}

/// Steps of one turn each: sagitta of a 32nd of the step.
class RingRules {
 public:
  static constexpr std::size_t kernel_every = 64;
  static constexpr double shortest_step_kernels = kShortestStepKernels;
  static constexpr double longest_step_kernels = kLongestStepKernels;
  double first_step_mm;

  RingRules(const ScalarField& field, PlaneCursor& plane, const ArcPlace& first, double h, std::stop_token stop)
      : first_step_mm{kFirstStepKernels * h},
        points{first.point},
        field_{field},
        plane_{plane},
        stop_{std::move(stop)} {}

  [[nodiscard]] bool goes_on() const { return points.size() < kMaxPoints && !stop_.stop_requested(); }
  [[nodiscard]] std::size_t places() const { return points.size(); }
  [[nodiscard]] double kernel_at(const Vec2& p) const { return field_.kernel_width_mm({p.x(), p.y(), plane_.z_mm()}); }
  [[nodiscard]] std::optional<ArcPlace> project(const Vec2& guess, double h, double most_move_mm) {
    const auto on = project_closely(plane_, guess, h, most_move_mm);
    if (!on) return std::nullopt;
    return ArcPlace::of(*on);
  }
  [[nodiscard]] ArcStep judge(const ArcPlace& here, const std::optional<ArcPlace>& next, const Vec2& chord,
                              double length, double step) const {
    const double turn = next ? std::atan2(cross(here.tangent, next->tangent), here.tangent.dot(next->tangent)) : 9;
    // The chord halves the turn on an arc; where it does not, the step jumped to another branch.
    const double lean = length > 0 ? std::abs(std::atan2(cross(here.tangent, chord), here.tangent.dot(chord))) : 9;
    if (std::abs(turn) > kTurnLimit || lean > kTurnLimit || length < 0.3 * step) return {0.4, true};
    return {0, false, turn};
  }
  [[nodiscard]] double closing_width(double length) const { return 0.3 * length; }
  void keep(const ArcPlace& place) { points.push_back(place.point); }
  [[nodiscard]] double next_step(double turn, double length, double h) const {
    return std::min(length * std::clamp(kTurn / std::max(std::abs(turn), 1e-6), 0.4, 2.0), kLongestStepKernels * h);
  }

  std::vector<Vec2> points;

 private:
  const ScalarField& field_;
  PlaneCursor& plane_;
  std::stop_token stop_;
};

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
  PlaneCursor plane{cursor, p.z()};
  const auto on = project_closely(plane, p.head<2>(), h_mm, limit_mm);
  if (!on) return std::nullopt;
  return Vec3{on->at.x_mm, on->at.y_mm, p.z()};
}

std::optional<Ring> trace_ring(const ScalarField& field, FieldCursor& cursor, const Vec3& start, std::stop_token stop) {
  const double h = field.kernel_width_mm(start);
  PlaneCursor plane{cursor, start.z()};
  const auto on = project_closely(plane, start.head<2>(), h, 0.2 * h);
  if (!on) return std::nullopt;
  const ArcPlace first = ArcPlace::of(*on);
  RingRules rules{field, plane, first, h, std::move(stop)};
  Ring ring;
  ring.closed = follow_arc(first, h, rules).closed;
  ring.z_mm = start.z();
  ring.points = std::move(rules.points);
  double area = 0;
  ring.low = ring.high = ring.points.front();
  for (std::size_t i = 0; i < ring.points.size(); ++i) {
    const Vec2& a = ring.points[i];
    area += cross(a - first.point, ring.points[i + 1 == ring.points.size() ? 0 : i + 1] - first.point);
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
