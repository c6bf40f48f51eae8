// SPDX-License-Identifier: GPL-3.0-or-later
#include <telefab/scan/registration/align.hpp>

#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>
#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <numbers>
#include <optional>

namespace telefab::scan {
namespace {

constexpr double kLeastNormalCosine = 0.5;

/// Tukey's weight at 4.7 robust sigmas: pairs that do not fit count for nothing.
void reweight(std::vector<Match>& matches) {
  if (matches.empty()) return;
  std::vector<double> size;
  size.reserve(matches.size());
  for (const Match& m : matches) size.push_back(std::abs(m.offset()));
  const auto middle = size.begin() + static_cast<std::ptrdiff_t>(size.size() / 2);
  std::nth_element(size.begin(), middle, size.end());
  const double reach = 4.7 * 1.4826 * std::max(*middle, 1e-12);
  for (Match& m : matches) {
    const double t = m.offset() / reach;
    m.weight *= std::abs(t) < 1 ? (1 - t * t) * (1 - t * t) : 0;
  }
}

}  // namespace

MotionDifference difference(const RigidMotion& a, const RigidMotion& b, const Vec3& at) {
  const Eigen::AngleAxisd turn{Eigen::Matrix3d{a.rotation().transpose() * b.rotation()}};
  return {std::abs(turn.angle()) * 180 / std::numbers::pi, (a * at - b * at).norm()};
}

RigidMotion moved_by(const Eigen::Matrix<double, 6, 1>& twist, const RigidMotion& to) {
  RigidMotion small = RigidMotion::Identity();
  const double angle = twist.head<3>().norm();
  if (angle > 0) small.linear() = Eigen::AngleAxisd{angle, twist.head<3>() / angle}.toRotationMatrix();
  small.translation() = twist.tail<3>();
  return small * to;
}

std::vector<Match> find_matches(std::span<const Eigen::Vector3f> points, std::span<const Eigen::Vector3f> normals,
                                std::span<const float> weights, const RigidMotion& source_to_world,
                                const AlignTarget& target, std::span<const float> usable,
                                const RigidMotion& target_to_world, double max_distance, std::size_t step) {
  const RigidMotion into_target = target_to_world.inverse() * source_to_world;
  const Eigen::Matrix3f turn = into_target.rotation().cast<float>();
  const Eigen::Matrix3d turn_to_world = target_to_world.rotation();
  const std::size_t count = (points.size() + step - 1) / step;
  std::vector<std::optional<Match>> found(count);
  tbb::parallel_for(tbb::blocked_range<std::size_t>{0, count, 256}, [&](const auto& range) {
    for (std::size_t s = range.begin(); s < range.end(); ++s) {
      const std::size_t i = s * step;
      const float weight = weights.empty() ? 1.F : weights[i];
      if (!(weight > 0)) continue;
      const Vec3 here = into_target * points[i].cast<double>();
      const auto near = target.tree.nearest_within(here.cast<float>(), static_cast<float>(max_distance));
      if (!near) continue;
      if (!usable.empty() && !(usable[near->index] > 0)) continue;
      if ((turn * normals[i]).dot(target.normals[near->index]) < kLeastNormalCosine) continue;
      found[s] = Match{target_to_world * here, target_to_world * target.points[near->index].cast<double>(),
                       turn_to_world * target.normals[near->index].cast<double>(), static_cast<double>(weight)};
    }
  });
  std::vector<Match> matches;
  matches.reserve(count);
  for (const auto& m : found)
    if (m) matches.push_back(*m);
  return matches;
}

double rms_of(std::span<const Match> matches) {
  double square = 0, weight = 0;
  for (const Match& m : matches) {
    square += m.weight * m.offset() * m.offset();
    weight += m.weight;
  }
  return weight > 0 ? std::sqrt(square / weight) : 0;
}

Result<Alignment> align(std::span<const Eigen::Vector3f> points, std::span<const Eigen::Vector3f> normals,
                        const AlignTarget& target, const RigidMotion& start, const AlignOptions& options,
                        std::stop_token stop) {
  Alignment result;
  result.motion = start;
  const std::size_t step = std::max<std::size_t>(1, points.size() / std::max<std::size_t>(options.samples, 100));
  const std::size_t sampled = (points.size() + step - 1) / step;
  double reach = options.first_distance;
  for (result.rounds = 1;; ++result.rounds) {
    if (stop.stop_requested()) return cancelled("aligning");
    std::vector<Match> matches =
        find_matches(points, normals, {}, result.motion, target, {}, RigidMotion::Identity(), reach, step);
    if (matches.size() < 30)
      return fail(ErrorCode::NotConverged, "the two clouds do not overlap: fewer than 30 matching points");
    reweight(matches);
    result.overlap = static_cast<double>(matches.size()) / static_cast<double>(sampled);
    result.rms = rms_of(matches);
    Vec3 middle = Vec3::Zero();
    for (const Match& m : matches) middle += m.source / static_cast<double>(matches.size());
    Eigen::Matrix<double, 6, 6> normal = Eigen::Matrix<double, 6, 6>::Zero();
    Eigen::Matrix<double, 6, 1> right = Eigen::Matrix<double, 6, 1>::Zero();
    for (const Match& m : matches) {
      Eigen::Matrix<double, 6, 1> j;
      j << (m.source - middle).cross(m.normal), m.normal;
      normal += m.weight * j * j.transpose();
      right -= m.weight * m.offset() * j;
    }
    // A surface that may slide on itself (sphere, plane) leaves directions open: they must not run away.
    const double size = std::max(normal.topLeftCorner<3, 3>().trace(), 1e-300),
                 count = std::max(normal.bottomRightCorner<3, 3>().trace(), 1e-300);
    normal.topLeftCorner<3, 3>().diagonal().array() += 1e-6 * size;
    normal.bottomRightCorner<3, 3>().diagonal().array() += 1e-6 * count;
    const Eigen::Matrix<double, 6, 1> twist = normal.ldlt().solve(right);
    if (!twist.allFinite()) return fail(ErrorCode::NotConverged, "the matching points do not fix a motion");
    const RigidMotion about =
        Eigen::Translation3d{middle} * moved_by(twist, RigidMotion::Identity()) * Eigen::Translation3d{-middle};
    result.motion = about * result.motion;
    const bool converged = twist.tail<3>().norm() < 1e-5 * options.last_distance && twist.head<3>().norm() < 1e-6;
    if (reach <= options.last_distance && (converged || result.rounds >= options.max_rounds)) return result;
    reach = std::max(options.last_distance, reach * 0.8);
  }
}

}  // namespace telefab::scan
