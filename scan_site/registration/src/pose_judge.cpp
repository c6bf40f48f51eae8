// SPDX-License-Identifier: GPL-3.0-or-later
#include "pose_judge.hpp"

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>
#include <map>
#include <tuple>

#include "free_space.hpp"

namespace telefab::scan {
namespace {

constexpr double kReach = 3;                 ///< spacings: how near counts as the same surface
constexpr double kClearance = 3;             ///< spacings in front of what was seen
constexpr std::size_t kSamples = 2000;       ///< points that look for matches, each way,
constexpr std::size_t kSamplesOfPair = 500;  ///< and more for each pair of views: patches must average
constexpr std::size_t kLeastMatches = 30;
constexpr double kPatch = 6;  ///< spacings: large enough for noise to average out, small against the shape
constexpr std::size_t kLeastInPatch = 4;

/// Every how many'th point of a view takes part where so many pairs of views are compared.
std::size_t step_for(const RangeImage& view, std::size_t pairs) {
  return std::max<std::size_t>(1, view.points.size() * pairs / (kSamples + kSamplesOfPair * pairs));
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

/// Matches between two sides, found from either. Patches are cubes, one for each way a surface may face.
struct TwoWayMatches {
  std::vector<Match> all;
  std::vector<double> sense;  ///< of each: 1 found from the one side, -1 from the other; offset * sense is one distance
  void add(const std::vector<Match>& some, double sign) {
    all.insert(all.end(), some.begin(), some.end());
    sense.resize(all.size(), sign);
  }
};

SurfaceFit fit_of(const TwoWayMatches& matches, double cube) {
  struct Patch {
    double weight = 0, offset = 0;
    std::size_t count = 0;
  };
  std::map<std::tuple<std::int64_t, std::int64_t, std::int64_t, int>, Patch> patches;
  for (std::size_t i = 0; i < matches.all.size(); ++i) {
    const Match& m = matches.all[i];
    Eigen::Index axis = 0;
    m.normal.cwiseAbs().maxCoeff(&axis);
    const auto cell = [&](double c) { return static_cast<std::int64_t>(std::floor(c / cube)); };
    Patch& patch = patches[{cell(m.target.x()), cell(m.target.y()), cell(m.target.z()),
                            static_cast<int>(2 * axis) + (m.normal[axis] < 0 ? 1 : 0)}];
    patch.weight += m.weight;
    patch.offset += m.weight * m.offset() * matches.sense[i];
    ++patch.count;
  }
  double square = 0, weight = 0;
  for (const auto& [place, patch] : patches) {
    if (patch.count < kLeastInPatch || !(patch.weight > 0)) continue;
    square += patch.offset * patch.offset / patch.weight;
    weight += patch.weight;
  }
  return {rms_of(matches.all), weight > 0 ? std::sqrt(square / weight) : 0};
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

std::vector<Match> match_views(const ViewSet& set, std::size_t from, const RigidMotion& from_pose, std::size_t to,
                               const RigidMotion& to_pose, std::size_t step) {
  return find_matches(set.views[from].points, set.views[from].normals, set.views[from].weight, from_pose,
                      set.targets[to], set.views[to].weight, to_pose, kReach * set.spacing, step);
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
  TwoWayMatches matches;
  FreeSpace free;
  const std::size_t pairs = a.members().size() * b.members().size();
  for (std::size_t i = 0; i < a.members().size(); ++i)
    for (std::size_t j = 0; j < b.members().size(); ++j) {
      const std::size_t va = a.members()[i], vb = b.members()[j];
      const RigidMotion &pose_a = a.poses()[i], pose_b = b_to_a * b.poses()[j];
      const RangeImage &view_a = set.views[va], &view_b = set.views[vb];
      matches.add(match_views(set, va, pose_a, vb, pose_b, step_for(view_a, pairs)), 1);
      matches.add(match_views(set, vb, pose_b, va, pose_a, step_for(view_b, pairs)), -1);
      const double clearance = kClearance * set.spacing;
      free += judge_points(view_a.points, view_a.weight, step_for(view_a, pairs), pose_b.inverse() * pose_a, view_b,
                           clearance);
      free += judge_points(view_b.points, view_b.weight, step_for(view_b, pairs), pose_a.inverse() * pose_b, view_a,
                           clearance);
    }
  figures.conflict = free.conflict();
  figures.overlap = a.surface().points.size() < b.surface().points.size()
                        ? overlap_of(a, b, b_to_a.inverse(), kReach * set.spacing)
                        : overlap_of(b, a, b_to_a, kReach * set.spacing);
  if (matches.all.size() < kLeastMatches) return {.overlap = 0, .conflict = figures.conflict};
  reweight(matches.all);
  figures.fit = fit_of(matches, kPatch * set.spacing);
  figures.stiffness = stiffness_of(matches.all);
  return figures;
}

std::optional<SurfaceFit> fit_within(const ViewSet& set, const ViewGroup& group) {
  TwoWayMatches matches;
  const std::size_t count = group.members().size();
  for (std::size_t i = 0; i < count; ++i)
    for (std::size_t j = 0; j < count; ++j)
      if (i != j)
        matches.add(match_views(set, group.members()[i], group.poses()[i], group.members()[j], group.poses()[j],
                                step_for(set.views[group.members()[i]], count * count)),
                    i < j ? 1 : -1);
  if (matches.all.size() < kLeastMatches) return std::nullopt;
  reweight(matches.all);
  return fit_of(matches, kPatch * set.spacing);
}

SurfaceFit fit_of_halves(const RangeImage& view, double spacing) {
  OrientedPoints even, odd;
  std::vector<float> even_weight, odd_weight;
  const auto put = [&](std::size_t i, bool is_even) {
    OrientedPoints& half = is_even ? even : odd;
    half.points.push_back(view.points[i]);
    half.normals.push_back(view.normals[i]);
    (is_even ? even_weight : odd_weight).push_back(view.weight[i]);
  };
  if (view.view.point_at.empty()) {
    for (std::size_t i = 0; i < view.points.size(); ++i) put(i, i % 2 == 0);
  } else {
    for (std::uint32_t r = 0; r < view.view.rows; ++r)
      for (std::uint32_t c = 0; c < view.view.columns; ++c)
        if (const std::int32_t i = view.view.at(r, c); i >= 0) put(static_cast<std::size_t>(i), (r + c) % 2 == 0);
  }
  if (even.points.empty() || odd.points.empty()) return {};
  const AlignTarget target{even.points, even.normals};
  TwoWayMatches matches;
  matches.add(find_matches(odd.points, odd.normals, odd_weight, RigidMotion::Identity(), target, even_weight,
                           RigidMotion::Identity(), kReach * spacing,
                           std::max<std::size_t>(1, odd.points.size() / (2 * kSamples))),
              1);
  if (matches.all.size() < kLeastMatches) return {};
  reweight(matches.all);
  return fit_of(matches, kPatch * spacing);
}

}  // namespace telefab::scan
