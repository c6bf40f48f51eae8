// SPDX-License-Identifier: GPL-3.0-or-later
#include "pose_judge.hpp"

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>

#include "free_space.hpp"

namespace telefab::scan {
namespace {

constexpr double kReach = 3;               ///< spacings: how near counts as the same surface
constexpr double kClearance = 3;           ///< spacings in front of what was seen
constexpr std::size_t kSamples = 6000;     ///< points of a body that look for matches
constexpr std::size_t kFreeSamples = 6000; ///< and that are held against the other's views
constexpr std::size_t kLeastMatches = 30;

std::size_t step_for(const RangeImage& view, std::size_t samples, std::size_t views) {
  return std::max<std::size_t>(1, view.points.size() * views / samples);
}

/// Tukey's weights about one scale for all matches, as the adjustment uses them.
void reweight(std::vector<Match>& matches) {
  std::vector<double> size;
  size.reserve(matches.size());
  for (const Match& m : matches) size.push_back(std::abs(m.offset()));
  const auto middle = size.begin() + static_cast<std::ptrdiff_t>(size.size() / 2);
  std::nth_element(size.begin(), middle, size.end());
  const double tukey = 4.7 * 1.4826 * std::max(*middle, 1e-12);
  for (Match& m : matches) {
    const double t = m.offset() / tukey;
    m.weight *= std::abs(t) < 1 ? (1 - t * t) * (1 - t * t) : 0;
  }
}

double stiffness_of(std::span<const Match> matches) {
  Vec3 middle = Vec3::Zero();
  double weight = 0;
  for (const Match& m : matches) {
    middle += m.weight * m.source;
    weight += m.weight;
  }
  if (!(weight > 0)) return 0;
  middle /= weight;
  double square = 0;
  for (const Match& m : matches) square += m.weight * (m.source - middle).squaredNorm();
  const double radius = std::sqrt(square / weight);
  if (!(radius > 0)) return 0;
  Eigen::Matrix<double, 6, 6> normal = Eigen::Matrix<double, 6, 6>::Zero();
  for (const Match& m : matches) {
    Eigen::Matrix<double, 6, 1> j;
    j << (m.source - middle).cross(m.normal) / radius, m.normal;
    normal += m.weight * j * j.transpose();
  }
  return std::max(0.0, Eigen::SelfAdjointEigenSolver<Eigen::Matrix<double, 6, 6>>{normal / weight}.eigenvalues()[0]);
}

void match_views(const ViewSet& set, std::size_t from, const RigidMotion& from_pose, std::size_t to,
                 const RigidMotion& to_pose, std::size_t step, std::vector<Match>& matches) {
  const auto some = find_matches(set.views[from].points, set.views[from].normals, set.views[from].weight, from_pose,
                                 set.targets[to], set.views[to].weight, to_pose, kReach * set.spacing, step);
  matches.insert(matches.end(), some.begin(), some.end());
}

/// Share of a's surface that lies on b's.
double overlap_of(const ViewGroup& a, const ViewGroup& b, const RigidMotion& a_to_b, double reach) {
  const std::size_t count = a.surface().points.size();
  const std::size_t step = std::max<std::size_t>(1, count / 2000);
  const auto matches = find_matches(a.surface().points, a.surface().normals, {}, a_to_b, b.target(), {},
                                    RigidMotion::Identity(), reach, step);
  return static_cast<double>(matches.size()) / static_cast<double>((count + step - 1) / step);
}

}  // namespace

PoseFigures figures_of(const ViewSet& set, const ViewGroup& a, const ViewGroup& b, const RigidMotion& b_to_a) {
  PoseFigures figures;
  std::vector<Match> matches;
  FreeSpace free;
  const std::size_t pairs_a = a.members().size(), pairs_b = b.members().size();
  for (std::size_t i = 0; i < pairs_a; ++i)
    for (std::size_t j = 0; j < pairs_b; ++j) {
      const std::size_t va = a.members()[i], vb = b.members()[j];
      const RigidMotion &pose_a = a.poses()[i], pose_b = b_to_a * b.poses()[j];
      const RangeImage &view_a = set.views[va], &view_b = set.views[vb];
      match_views(set, va, pose_a, vb, pose_b, step_for(view_a, kSamples, pairs_a * pairs_b), matches);
      match_views(set, vb, pose_b, va, pose_a, step_for(view_b, kSamples, pairs_a * pairs_b), matches);
      const double clearance = kClearance * set.spacing;
      free += judge_points(view_a.points, view_a.weight, step_for(view_a, kFreeSamples, pairs_a * pairs_b),
                           pose_b.inverse() * pose_a, view_b, clearance);
      free += judge_points(view_b.points, view_b.weight, step_for(view_b, kFreeSamples, pairs_a * pairs_b),
                           pose_a.inverse() * pose_b, view_a, clearance);
    }
  figures.conflict = free.conflict();
  figures.overlap = a.surface().points.size() < b.surface().points.size()
                        ? overlap_of(a, b, b_to_a.inverse(), kReach * set.spacing)
                        : overlap_of(b, a, b_to_a, kReach * set.spacing);
  if (matches.size() < kLeastMatches) return {.overlap = 0, .conflict = figures.conflict};
  reweight(matches);
  figures.rms = rms_of(matches);
  figures.stiffness = stiffness_of(matches);
  return figures;
}

std::optional<double> rms_within(const ViewSet& set, const ViewGroup& group) {
  std::vector<Match> matches;
  const std::size_t count = group.members().size();
  for (std::size_t i = 0; i < count; ++i)
    for (std::size_t j = 0; j < count; ++j)
      if (i != j)
        match_views(set, group.members()[i], group.poses()[i], group.members()[j], group.poses()[j],
                    step_for(set.views[group.members()[i]], kSamples, count * count), matches);
  if (matches.size() < kLeastMatches) return std::nullopt;
  reweight(matches);
  return rms_of(matches);
}

}  // namespace telefab::scan
