// SPDX-License-Identifier: GPL-3.0-or-later
#include <algorithm>
#include <cmath>
#include <optional>
#include <telefab/scan/contour/reeb_marcher.hpp>
#include <variant>

#include "segment_grid.hpp"

namespace telefab::scan {
namespace {

using contour::SegmentGrid;
using contour::Vec2;

constexpr double kTurnLimit = 0.7;  // radians between two vertices
constexpr double kFirstStepKernels = 0.05;
constexpr double kShortestStepKernels = 1e-5;
constexpr double kResidualShare = 0.02;      // of ds, of a vertex
constexpr double kSameContourKernels = 0.1;  // a seed this near to a contour belongs to it
constexpr double kCoverKernels = 0.5;        // a sample this near to a contour belongs to it
constexpr double kLevelNz = 0.95;            // flatter samples say nothing about where a plane cuts

double cross(const Vec2& a, const Vec2& b) { return a.x() * b.y() - a.y() * b.x(); }

struct Vertex {
  Vec2 point;
  Vec2 tangent;  ///< unit, solid on the left
  double closeness_mm = 0;
};

/// A march that gave no contour, and the way it went.
struct LostMarch {
  MarchProblem problem;
  std::vector<Point2> way;
};

class Marcher {
 public:
  Marcher(const ScalarField& field, FieldCursor& cursor, double z_mm, const MarchOptions& options)
      : field_{field}, cursor_{cursor}, z_mm_{z_mm}, options_{options} {}

  [[nodiscard]] double kernel_at(const Vec2& p) const { return field_.kernel_width_mm({p.x(), p.y(), z_mm_}); }
  [[nodiscard]] std::uint64_t evaluations() const { return evaluations_; }

  /// Newton within the plane. A step so short that the next would be below the tolerance is not checked again.
  std::optional<Vertex> project_in_plane(Vec2 p, double h, double limit_mm) {
    const Vec2 start = p;
    const double tolerance = kResidualShare * options_.chord_mm;
    for (int i = 0; i < 12; ++i) {
      const FieldSample f = cursor_.at({p.x(), p.y(), z_mm_});
      ++evaluations_;
      const Vec2 slope = f.gradient.head<2>();
      const double steep = slope.norm();
      if (!f.in_reach || !(steep > 1e-4)) return std::nullopt;
      Vec2 step = -f.value_mm / (steep * steep) * slope;
      const double length = step.norm();
      if (length > 0.25 * h) step *= 0.25 * h / length;
      p += step;
      if ((p - start).norm() > limit_mm) return std::nullopt;
      if (length * length < 0.5 * tolerance * h * steep)
        return Vertex{p, Vec2{-slope.y(), slope.x()} / steep, std::abs(f.closeness_mm)};
    }
    return std::nullopt;
  }

  std::variant<Contour, LostMarch> around(const Vertex& first) {
    double h = kernel_at(first.point);
    const double ds = options_.chord_mm;
    std::vector<Point2> ring{{first.point.x(), first.point.y()}};
    const auto lost = [&](MarchProblem::Kind kind, const Vec2& p) {
      return LostMarch{{kind, {p.x(), p.y()}}, std::move(ring)};
    };
    double closeness = first.closeness_mm;
    Vertex here = first;
    double step = std::min(kFirstStepKernels * h, 4 * ds);
    double bend = 0;
    while (ring.size() < options_.max_vertices) {
      if (ring.size() % 32 == 0) h = kernel_at(here.point);
      step = std::min(step, options_.longest_step_kernels * h);
      const Vec2 left{-here.tangent.y(), here.tangent.x()};
      const auto next =
          project_in_plane(here.point + step * here.tangent + 0.5 * bend * step * step * left, h, 0.5 * step);
      const Vec2 chord = next ? Vec2{next->point - here.point} : Vec2{0, 0};
      const double length = chord.norm();
      if (!next || length < 0.3 * step) {
        step *= 0.35;
        bend = 0;
        if (step < kShortestStepKernels * h) return lost(MarchProblem::Kind::Open, here.point);
        continue;
      }
      // Angles of the chord with both tangents: equal on an arc (sagitta L a / 4), opposite on a bend.
      const double leave = std::atan2(cross(here.tangent, chord), here.tangent.dot(chord));
      const double arrive = std::atan2(cross(chord, next->tangent), chord.dot(next->tangent));
      const double sagitta = length * (std::abs(leave) + std::abs(arrive)) / 8;
      if (std::abs(leave) + std::abs(arrive) > kTurnLimit || sagitta > 1.05 * ds) {
        step *= std::clamp(std::sqrt(0.8 * ds / std::max(sagitta, 1e-12)), 0.25, 0.7);
        if (step < kShortestStepKernels * h) return lost(MarchProblem::Kind::Open, here.point);
        continue;
      }
      const Vec2 to_start = first.point - here.point;
      const double along = to_start.dot(chord) / length;
      if (ring.size() > 3 && along > 0 && along <= length * 1.0001 &&
          std::abs(cross(chord, to_start)) / length < std::max(3 * ds, 0.2 * length) &&
          first.tangent.dot(here.tangent) > 0.3) {
        if (closeness / static_cast<double>(ring.size()) > options_.pick_kernels * h)
          return lost(MarchProblem::Kind::FalseBranch, first.point);
        // A last vertex on top of the first adds nothing.
        if (to_start.norm() < 0.05 * length && ring.size() > 4) ring.pop_back();
        auto contour = Contour::from_vertices(std::move(ring));
        if (!contour) return lost(MarchProblem::Kind::NoArea, first.point);
        return std::move(*contour);
      }
      ring.push_back({next->point.x(), next->point.y()});
      closeness += next->closeness_mm;
      const double turn = leave + arrive;
      bend = turn / length;
      here = *next;
      // The paper's step for the radius of this turn, approached by at most a doubling.
      const double radius = std::abs(bend) > 1e-9 ? 1 / std::abs(bend) : 1e9;
      const double wanted = 2 * std::sqrt(std::max(2 * radius * ds - ds * ds, ds * ds)) * 0.92;
      step = std::clamp(wanted, 0.5 * length, 2 * length);
    }
    return lost(MarchProblem::Kind::Open, here.point);
  }

 private:
  const ScalarField& field_;
  FieldCursor& cursor_;
  double z_mm_;
  const MarchOptions& options_;
  std::uint64_t evaluations_ = 0;
};

/// Where the surface through the sample meets the plane, to first order; none for level samples and long ways.
std::optional<Vec2> moved_to_plane(const Vec3& p, const Vec3& n, double z_mm, double h) {
  if (std::abs(n.z()) > kLevelNz) return std::nullopt;
  const Vec2 across = n.head<2>();
  const Vec2 shift = -(z_mm - p.z()) * n.z() / across.squaredNorm() * across;
  if (shift.norm() > h) return std::nullopt;
  return p.head<2>() + shift;
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
                                    std::span<const Vec3> seeds, const NearSamples& near_plane,
                                    const MarchOptions& options, std::stop_token stop) {
  if (const auto valid = options.validate(); !valid) return tl::unexpected{valid.error()};
  MarchedLayer layer;
  if (seeds.empty() && near_plane.points.empty()) return layer;
  const Vec3 any = seeds.empty() ? near_plane.points.front() : seeds.front();
  SegmentGrid grid{field.kernel_width_mm(any)};
  Marcher marcher{field, cursor, z_mm, options};
  // One failure a way is enough: every sample beside an open contour would go the same way again.
  SegmentGrid failed{field.kernel_width_mm(any)};

  const auto try_seed = [&](const Vec2& seed, bool must_lead) {
    const double h = marcher.kernel_at(seed);
    const auto first = marcher.project_in_plane(seed, h, options.seed_reach_kernels * h);
    if (!first) {
      if (must_lead) layer.problems.push_back({MarchProblem::Kind::SeedOffSurface, {seed.x(), seed.y()}});
      return false;
    }
    const Vec2 outward{first->tangent.y(), -first->tangent.x()};
    if (grid.runs_beside(first->point, outward, std::max(kSameContourKernels * h, 3 * options.chord_mm))) return false;
    auto found = marcher.around(*first);
    if (const auto* lost = std::get_if<LostMarch>(&found)) {
      layer.problems.push_back(lost->problem);
      if (lost->problem.kind == MarchProblem::Kind::Open) failed.add_path(lost->way);
      return false;
    }
    layer.contours.push_back(std::move(std::get<Contour>(found)));
    grid.add(layer.contours.back().vertices());
    return true;
  };

  for (const Vec3& seed : seeds) {
    if (stop.stop_requested()) return fail(ErrorCode::Cancelled, "stopped while marching a layer");
    try_seed(seed.head<2>(), true);
  }
  for (std::size_t i = 0; i < near_plane.points.size(); ++i) {
    const double h = field.kernel_width_mm(near_plane.points[i]);
    const auto p = moved_to_plane(near_plane.points[i], near_plane.normals[i], z_mm, h);
    if (!p || grid.runs_beside(*p, near_plane.normals[i].head<2>(), kCoverKernels * h)) continue;
    if (failed.runs_beside(*p, near_plane.normals[i].head<2>(), kCoverKernels * h)) continue;
    if (stop.stop_requested()) return fail(ErrorCode::Cancelled, "stopped while marching a layer");
    const std::size_t problems = layer.problems.size();
    if (try_seed(*p, false)) {
      ++layer.from_coverage;
    } else if (layer.problems.size() > problems) {
      const Vec2 side = 0.01 * h * Vec2{-near_plane.normals[i].y(), near_plane.normals[i].x()};
      const Point2 ends[2] = {{p->x() - side.x(), p->y() - side.y()}, {p->x() + side.x(), p->y() + side.y()}};
      failed.add_path(ends);
    }
  }
  layer.evaluations = marcher.evaluations();
  return layer;
}

std::vector<std::size_t> uncovered_samples(const ScalarField& field, double z_mm, std::span<const Contour> contours,
                                           const NearSamples& near_plane, double reach_kernels) {
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
