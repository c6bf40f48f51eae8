// SPDX-License-Identifier: GPL-3.0-or-later
#include "turntable.hpp"

#include <tbb/parallel_for.h>
#include <Eigen/Dense>
#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>
#include <tuple>

namespace telefab::scan {
namespace {

constexpr int kGridSteps = 15;               ///< candidates across the box, each way
constexpr std::size_t kCoarseSamples = 150;  ///< points a view in the search
constexpr std::size_t kCoarsePairs = 6;
constexpr std::size_t kRefined = 8;  ///< candidates that are refined
constexpr std::size_t kRefineSamples = 500;
constexpr int kRefineRounds = 25;

Box3 box_of(std::span<const RangeImage> views) {
  Box3 box = Box3::nothing();
  for (const RangeImage& v : views)
    for (const auto& p : v.points) box.include(p.cast<double>());
  return box;
}

using Pair = std::pair<std::size_t, std::size_t>;  ///< source view, the view before it

std::vector<Pair> neighbours(std::size_t views, bool closed) {
  std::vector<Pair> pairs;
  for (std::size_t i = 1; i < views; ++i) pairs.emplace_back(i, i - 1);
  if (closed && views > 2) pairs.emplace_back(0, views - 1);
  return pairs;
}

std::vector<Match> matches_at(std::span<const RangeImage> views, std::span<const AlignTarget> targets,
                              std::span<const Pair> pairs, const RigidMotion& step, double reach, std::size_t samples,
                              std::size_t& sampled) {
  std::vector<Match> all;
  sampled = 0;
  for (const auto& [source, target] : pairs) {
    const RangeImage& v = views[source];
    const std::size_t every = std::max<std::size_t>(1, v.points.size() / samples);
    sampled += (v.points.size() + every - 1) / every;
    const auto some = find_matches(v.points, v.normals, {}, step, targets[target], views[target].weight,
                                   RigidMotion::Identity(), reach, every);
    all.insert(all.end(), some.begin(), some.end());
  }
  return all;
}

struct Candidate {
  TurntableAxis axis;
  double score = 0;
};

/// Turns the free motion that fits best back into a turn by the known angle about an axis.
TurntableAxis axis_of(const RigidMotion& motion, const TurntableAxis& before, double step_rad, const Vec3& near) {
  const Eigen::AngleAxisd turn{motion.rotation()};
  TurntableAxis axis;
  axis.direction = turn.axis().dot(before.direction) < 0 ? Vec3{-turn.axis()} : turn.axis();
  const Eigen::Matrix3d rotation = Eigen::AngleAxisd{step_rad, axis.direction}.toRotationMatrix();
  // (1 - R) c = t across the axis; the least-norm answer relative to `near` is the point nearest to it
  const Vec3 shift = motion * near - near;
  const Vec3 across = shift - axis.direction * axis.direction.dot(shift);
  axis.point = near + (Eigen::Matrix3d::Identity() - rotation).completeOrthogonalDecomposition().solve(across);
  return axis;
}

Candidate refine(Candidate candidate, std::span<const RangeImage> views, std::span<const AlignTarget> targets,
                 std::span<const Pair> pairs, double step_rad, const Box3& box, double spacing) {
  double reach = box.size().maxCoeff() / 12;
  const double last = 4 * spacing;
  std::size_t sampled = 0;
  for (int round = 0; round < kRefineRounds; ++round) {
    const RigidMotion step = step_motion(candidate.axis, step_rad);
    const std::vector<Match> matches = matches_at(views, targets, pairs, step, reach, kRefineSamples, sampled);
    if (matches.size() < 50) break;
    Eigen::Matrix<double, 6, 6> normal = Eigen::Matrix<double, 6, 6>::Zero();
    Eigen::Matrix<double, 6, 1> right = Eigen::Matrix<double, 6, 1>::Zero();
    const Vec3 middle = box.middle();
    for (const Match& m : matches) {
      const double t = m.offset() / reach, weight = m.weight * (1 - t * t) * (1 - t * t);
      Eigen::Matrix<double, 6, 1> j;
      j << (m.source - middle).cross(m.normal), m.normal;
      normal += weight * j * j.transpose();
      right -= weight * m.offset() * j;
    }
    normal.diagonal() *= 1.0001;
    const Eigen::Matrix<double, 6, 1> twist = normal.ldlt().solve(right);
    if (!twist.allFinite()) break;
    const RigidMotion about =
        Eigen::Translation3d{middle} * moved_by(twist, RigidMotion::Identity()) * Eigen::Translation3d{-middle};
    candidate.axis = axis_of(about * step, candidate.axis, step_rad, middle);
    reach = std::max(last, reach * 0.82);
  }
  const std::vector<Match> matches =
      matches_at(views, targets, pairs, step_motion(candidate.axis, step_rad), last, kRefineSamples, sampled);
  double fit = 0;
  for (const Match& m : matches) fit += std::max(0.0, 1 - std::abs(m.offset()) / spacing);
  candidate.score = sampled > 0 ? fit / static_cast<double>(sampled) : 0;
  return candidate;
}

}  // namespace

RigidMotion step_motion(const TurntableAxis& axis, double step_rad) {
  return Eigen::Translation3d{axis.point} * Eigen::AngleAxisd{step_rad, axis.direction} *
         Eigen::Translation3d{-axis.point};
}

Result<AxisFit> find_axis(std::span<const RangeImage> views, std::span<const AlignTarget> targets, bool closed_turn,
                          const RegisterOptions& options, const std::stop_token& stop) {
  const Box3 box = box_of(views);
  const double step_rad = options.step_deg * std::numbers::pi / 180;
  double spacing = 0;
  for (const RangeImage& v : views) spacing = std::max(spacing, static_cast<double>(v.spacing));
  const std::vector<Pair> all_pairs = neighbours(views.size(), closed_turn);
  std::vector<Pair> some_pairs;
  for (std::size_t i = 0; i < std::min(all_pairs.size(), kCoarsePairs); ++i)
    some_pairs.push_back(all_pairs[i * all_pairs.size() / std::min(all_pairs.size(), kCoarsePairs)]);

  std::vector<Candidate> candidates;
  const std::vector<Vec3> directions = options.axis_direction
                                           ? std::vector<Vec3>{options.axis_direction->normalized()}
                                           : std::vector<Vec3>{Vec3::UnitY(), Vec3::UnitZ(), Vec3::UnitX()};
  for (const Vec3& direction : directions)
    for (const double sense : {1.0, -1.0}) {
      const Vec3 u = direction.unitOrthogonal(), v = direction.cross(u);
      for (int a = 0; a < kGridSteps; ++a)
        for (int b = 0; b < kGridSteps; ++b) {
          const auto offset = [&](int i) { return box.size().maxCoeff() * 0.75 * (2.0 * i / (kGridSteps - 1) - 1); };
          candidates.push_back({{direction * sense, box.middle() + u * offset(a) + v * offset(b)}, 0});
        }
    }
  const double coarse_reach = box.size().maxCoeff() / 20;
  tbb::parallel_for(std::size_t{0}, candidates.size(), [&](std::size_t i) {
    if (stop.stop_requested()) return;
    std::size_t sampled = 0;
    const auto matches = matches_at(views, targets, some_pairs, step_motion(candidates[i].axis, step_rad), coarse_reach,
                                    kCoarseSamples, sampled);
    for (const Match& m : matches) candidates[i].score += 1 - (m.source - m.target).norm() / coarse_reach;
    candidates[i].score /= static_cast<double>(std::max<std::size_t>(sampled, 1));
  });
  if (stop.stop_requested()) return cancelled("searching the axis");
  std::stable_sort(candidates.begin(), candidates.end(),
                   [](const Candidate& l, const Candidate& r) { return l.score > r.score; });
  candidates.resize(std::min(candidates.size(), kRefined));
  for (Candidate& c : candidates) {
    if (stop.stop_requested()) return cancelled("searching the axis");
    c = refine(c, views, targets, all_pairs, step_rad, box, spacing);
  }
  const Candidate& best = *std::max_element(candidates.begin(), candidates.end(),
                                            [](const Candidate& l, const Candidate& r) { return l.score < r.score; });
  if (!(best.score > 0)) return fail(ErrorCode::NotConverged, "no axis was found about which the views fit together");
  return AxisFit{best.axis, best.score};
}

}  // namespace telefab::scan
