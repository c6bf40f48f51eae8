// SPDX-License-Identifier: GPL-3.0-or-later
#include <algorithm>
#include <cmath>
#include <optional>
#include <telefab/scan/contour/reeb_marcher.hpp>
#include <telefab/scan/section/follow_arc.hpp>
#include <variant>

#include "segment_grid.hpp"

namespace telefab::scan {
namespace {

using contour::SegmentGrid;

constexpr double kTurnLimit = 0.7;  // radians between two vertices
constexpr double kFirstStepKernels = 0.05;
constexpr double kShortestStepKernels = 1e-5;
constexpr double kResidualShare = 0.02;      // of ds, of a vertex
constexpr double kSameContourKernels = 0.1;  // a seed this near to a contour belongs to it
constexpr double kCoverKernels = 0.5;        // a sample this near to a contour belongs to it
constexpr double kLeastAcross = 0.31225;     // in-plane part of a normal of n_z 0.95; flatter samples say nothing

/// A march that gave no contour, and the way it went.
struct LostMarch {
  MarchProblem problem;
  std::vector<Point2> way;
};

bool is_spent(const PlaneCursor& plane, const MarchOptions& options) {
  return options.most_evaluations && plane.evaluations() >= *options.most_evaluations;
}

/// The paper's steps: 2 sqrt(2 r ds - ds^2) from the radius of the turn before, and arc and chord agree within ds.
class MarchRules {
 public:
  static constexpr std::size_t kernel_every = 32;
  static constexpr double shortest_step_kernels = kShortestStepKernels;
  double first_step_mm, longest_step_kernels;

  MarchRules(const ScalarField& field, PlaneCursor& plane, const MarchOptions& options, const ArcPlace& first, double h)
      : first_step_mm{std::min(kFirstStepKernels * h, 4 * options.chord_mm)},
        longest_step_kernels{options.longest_step_kernels},
        ring{{first.point.x(), first.point.y()}},
        closeness_mm{first.closeness_mm},
        field_{field},
        plane_{plane},
        options_{options} {}

  [[nodiscard]] bool goes_on() const { return ring.size() < options_.max_vertices && !is_spent(plane_, options_); }
  [[nodiscard]] std::size_t places() const { return ring.size(); }
  double kernel_at(const Vec2& p) { return kernel = field_.kernel_width_mm({p.x(), p.y(), plane_.z_mm()}); }
  [[nodiscard]] std::optional<ArcPlace> project(const Vec2& guess, double h, double most_move_mm) {
    return project_to_chord(plane_, guess, h, most_move_mm, options_.chord_mm);
  }
  [[nodiscard]] ArcStep judge(const ArcPlace& here, const std::optional<ArcPlace>& next, const Vec2& chord,
                              double length, double step) const {
    if (!next || length < 0.3 * step) return {0.35, true};
    // Angles of the chord with both tangents: equal on an arc (sagitta L a / 4), opposite on a bend.
    const double leave = std::atan2(cross(here.tangent, chord), here.tangent.dot(chord));
    const double arrive = std::atan2(cross(chord, next->tangent), chord.dot(next->tangent));
    const double sagitta = length * (std::abs(leave) + std::abs(arrive)) / 8;
    const bool turns = std::abs(leave) + std::abs(arrive) > kTurnLimit;
    if (turns || sagitta > 1.05 * options_.chord_mm)
      return {std::clamp(std::sqrt(0.8 * options_.chord_mm / std::max(sagitta, 1e-12)), 0.25, 0.7), false, 0, !turns};
    return {0, false, leave + arrive};
  }
  [[nodiscard]] double closing_width(double length) const { return std::max(3 * options_.chord_mm, 0.2 * length); }
  void keep(const ArcPlace& place) {
    ring.push_back({place.point.x(), place.point.y()});
    closeness_mm += place.closeness_mm;
  }
  /// The paper's step for the radius of this turn, approached by at most a doubling.
  [[nodiscard]] double next_step(double turn, double length, double) const {
    const double ds = options_.chord_mm, bend = turn / length;
    const double radius = std::abs(bend) > 1e-9 ? 1 / std::abs(bend) : 1e9;
    const double wanted = 2 * std::sqrt(std::max(2 * radius * ds - ds * ds, ds * ds)) * 0.92;
    return std::clamp(wanted, 0.5 * length, 2 * length);
  }

  /// Newton within the plane. A step so short that the next would be below the tolerance is not checked again.
  static std::optional<ArcPlace> project_to_chord(PlaneCursor& plane, const Vec2& from, double h, double most_move_mm,
                                                  double chord_mm) {
    const double tolerance = kResidualShare * chord_mm;
    const auto on =
        plane.project({from.x(), from.y()}, {0.25 * h, most_move_mm}, [&](const PlaneSample& s, double length, int) {
          return length * length < 0.5 * tolerance * h * s.steep ? Arrival::AfterStep : Arrival::GoOn;
        });
    if (!on) return std::nullopt;
    return ArcPlace::of(*on);
  }

  std::vector<Point2> ring;
  double closeness_mm;  ///< of all vertices together
  double kernel = 0;    ///< asked for last

 private:
  const ScalarField& field_;
  PlaneCursor& plane_;
  const MarchOptions& options_;
};

std::variant<Contour, LostMarch> march_around(const ScalarField& field, PlaneCursor& plane, const MarchOptions& options,
                                              const ArcPlace& first) {
  const double h = field.kernel_width_mm({first.point.x(), first.point.y(), plane.z_mm()});
  MarchRules rules{field, plane, options, first, h};
  rules.kernel = h;
  const ArcEnd end = follow_arc(first, h, rules);
  const auto lost = [&](MarchProblem::Kind kind, const Vec2& p) {
    return LostMarch{{kind, {p.x(), p.y()}}, std::move(rules.ring)};
  };
  if (!end.closed) return lost(MarchProblem::Kind::Open, end.here);
  if (rules.closeness_mm / static_cast<double>(rules.ring.size()) > options.pick_kernels * rules.kernel)
    return lost(MarchProblem::Kind::FalseBranch, first.point);
  // A last vertex on top of the first adds nothing.
  if (end.gap_mm < 0.05 * end.step_mm && rules.ring.size() > 4) rules.ring.pop_back();
  auto contour = Contour::from_vertices(std::move(rules.ring));
  if (!contour) return lost(MarchProblem::Kind::NoArea, first.point);
  return std::move(*contour);
}

/// Where the surface through the sample meets the plane, to first order; none for level samples and long ways.
std::optional<Vec2> moved_to_plane(const Vec3& p, const Vec3& n, double z_mm, double h) {
  return first_order_crossing(p, n, z_mm, h, kLeastAcross);
}

}  // namespace

Result<void> MarchOptions::validate() const {
  if (!(chord_mm > 0)) return fail(ErrorCode::InvalidInput, "chord_mm must be positive");
  if (!(longest_step_kernels > 0 && longest_step_kernels <= 4))
    return fail(ErrorCode::InvalidInput, "longest_step_kernels must lie in (0, 4]");
  if (!(pick_kernels > 0)) return fail(ErrorCode::InvalidInput, "pick_kernels must be positive");
  if (!(seed_reach_kernels > 0)) return fail(ErrorCode::InvalidInput, "seed_reach_kernels must be positive");
  if (max_vertices < 8) return fail(ErrorCode::InvalidInput, "max_vertices must be at least 8");
  return {};
}

Result<MarchedLayer> march_contours(const ScalarField& field, FieldCursor& cursor, double z_mm,
                                    std::span<const Vec3> seeds, const SampleView& near_plane,
                                    const MarchOptions& options, std::stop_token stop) {
  if (const auto valid = options.validate(); !valid) return tl::unexpected{valid.error()};
  MarchedLayer layer;
  if (seeds.empty() && near_plane.points.empty()) return layer;
  const Vec3 any = seeds.empty() ? near_plane.points.front() : seeds.front();
  SegmentGrid grid{field.kernel_width_mm(any)};
  PlaneCursor plane{cursor, z_mm};
  // One failure a way is enough: every sample beside an open contour would go the same way again.
  SegmentGrid failed{field.kernel_width_mm(any)};

  const auto try_seed = [&](const Vec2& seed, bool must_lead) {
    const double h = field.kernel_width_mm({seed.x(), seed.y(), z_mm});
    const auto first = MarchRules::project_to_chord(plane, seed, h, options.seed_reach_kernels * h, options.chord_mm);
    if (!first) {
      if (must_lead) layer.problems.push_back({MarchProblem::Kind::SeedOffSurface, {seed.x(), seed.y()}});
      return false;
    }
    const Vec2 outward{first->tangent.y(), -first->tangent.x()};
    if (grid.runs_beside(first->point, outward, std::max(kSameContourKernels * h, 3 * options.chord_mm))) return false;
    auto found = march_around(field, plane, options, *first);
    if (const auto* lost = std::get_if<LostMarch>(&found)) {
      layer.problems.push_back(lost->problem);
      if (lost->problem.kind == MarchProblem::Kind::Open) failed.add_path(lost->way);
      return false;
    }
    layer.contours.push_back(std::move(std::get<Contour>(found)));
    grid.add(layer.contours.back().vertices());
    return true;
  };

  const auto spent_at = [&](const Vec2& place) {
    if (!is_spent(plane, options)) return false;
    layer.problems.push_back({MarchProblem::Kind::TooLong, {place.x(), place.y()}});
    return true;
  };
  for (const Vec3& seed : seeds) {
    if (spent_at(seed.head<2>())) break;
    if (stop.stop_requested()) return cancelled("marching a layer");
    try_seed(seed.head<2>(), true);
  }
  for (std::size_t i = 0; i < near_plane.points.size(); ++i) {
    const double h = field.kernel_width_mm(near_plane.points[i]);
    const auto p = moved_to_plane(near_plane.points[i], near_plane.normals[i], z_mm, h);
    if (!p || grid.runs_beside(*p, near_plane.normals[i].head<2>(), kCoverKernels * h)) continue;
    if (failed.runs_beside(*p, near_plane.normals[i].head<2>(), kCoverKernels * h)) continue;
    if (spent_at(*p)) break;
    if (stop.stop_requested()) return cancelled("marching a layer");
    const std::size_t problems = layer.problems.size();
    if (try_seed(*p, false)) {
      ++layer.from_coverage;
    } else if (layer.problems.size() > problems) {
      const Vec2 side = 0.01 * h * Vec2{-near_plane.normals[i].y(), near_plane.normals[i].x()};
      const Point2 ends[2] = {{p->x() - side.x(), p->y() - side.y()}, {p->x() + side.x(), p->y() + side.y()}};
      failed.add_path(ends);
    }
  }
  layer.evaluations = plane.evaluations();
  return layer;
}

std::vector<std::size_t> uncovered_samples(const ScalarField& field, double z_mm, std::span<const Contour> contours,
                                           const SampleView& near_plane, double reach_kernels) {
  std::vector<std::size_t> uncovered;
  if (near_plane.points.empty()) return uncovered;
  double widest = 0;
  for (const Vec3& p : near_plane.points) widest = std::max(widest, field.kernel_width_mm(p));
  SegmentGrid grid{reach_kernels * widest};
  for (const Contour& c : contours) grid.add(c.vertices());
  for (std::size_t i = 0; i < near_plane.points.size(); ++i) {
    const double h = field.kernel_width_mm(near_plane.points[i]);
    const auto p = moved_to_plane(near_plane.points[i], near_plane.normals[i], z_mm, h);
    if (p && !grid.runs_beside(*p, near_plane.normals[i].head<2>(), reach_kernels * h)) uncovered.push_back(i);
  }
  return uncovered;
}

}  // namespace telefab::scan
