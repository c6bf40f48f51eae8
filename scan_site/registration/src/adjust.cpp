// SPDX-License-Identifier: GPL-3.0-or-later
#include "adjust.hpp"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>

#include "free_space.hpp"

namespace telefab::scan {
namespace {

double robust_reach(std::span<const std::vector<Match>> matches) {
  std::vector<double> size;
  for (const auto& link : matches)
    for (const Match& m : link) size.push_back(std::abs(m.offset()));
  if (size.empty()) return 0;
  const auto middle = size.begin() + static_cast<std::ptrdiff_t>(size.size() / 2);
  std::nth_element(size.begin(), middle, size.end());
  return 4.7 * 1.4826 * std::max(*middle, 1e-12);
}

}  // namespace

Result<std::vector<std::vector<Match>>> adjust_all(std::span<const RangeImage> views,
                                                   std::span<const AlignTarget> targets, std::span<const Link> links,
                                                   const AdjustOptions& options, std::vector<RigidMotion>& poses,
                                                   const std::stop_token& stop) {
  const auto unknowns = static_cast<Eigen::Index>(6 * views.size());
  double reach = options.first_reach;
  std::vector<std::vector<Match>> matches(links.size());
  for (int round = 0;; ++round) {
    if (stop.stop_requested()) return cancelled("adjusting the poses");
    for (std::size_t l = 0; l < links.size(); ++l) {
      const RangeImage& from = views[links[l].from];
      const std::size_t step = std::max<std::size_t>(1, from.points.size() / options.samples);
      matches[l] = find_matches(from.points, from.normals, from.weight, poses[links[l].from], targets[links[l].to],
                                views[links[l].to].weight, poses[links[l].to], reach, step);
    }
    const double tukey = robust_reach(matches);
    if (!(tukey > 0)) return fail(ErrorCode::NotConverged, "no view fits another one");
    Vec3 middle = Vec3::Zero();
    std::size_t count = 0;
    for (const auto& link : matches)
      for (const Match& m : link) {
        middle += m.source;
        ++count;
      }
    middle /= static_cast<double>(count);
    Eigen::MatrixXd normal = Eigen::MatrixXd::Zero(unknowns, unknowns);
    Eigen::VectorXd right = Eigen::VectorXd::Zero(unknowns);
    for (std::size_t l = 0; l < links.size(); ++l) {
      Eigen::Matrix<double, 6, 6> block = Eigen::Matrix<double, 6, 6>::Zero();
      Eigen::Matrix<double, 6, 1> pull = Eigen::Matrix<double, 6, 1>::Zero();
      for (Match& m : matches[l]) {
        const double t = m.offset() / tukey;
        m.weight *= std::abs(t) < 1 ? (1 - t * t) * (1 - t * t) : 0;
        Eigen::Matrix<double, 6, 1> j;
        j << (m.source - middle).cross(m.normal), m.normal;
        block.noalias() += m.weight * j * j.transpose();
        pull -= m.weight * m.offset() * j;
      }
      const auto a = static_cast<Eigen::Index>(6 * links[l].from), b = static_cast<Eigen::Index>(6 * links[l].to);
      normal.block<6, 6>(a, a) += block;
      normal.block<6, 6>(b, b) += block;
      normal.block<6, 6>(a, b) -= block;
      normal.block<6, 6>(b, a) -= block;
      right.segment<6>(a) += pull;
      right.segment<6>(b) -= pull;
    }
    const double anchor = normal.diagonal().maxCoeff();
    normal.topLeftCorner<6, 6>().diagonal().array() += 1e6 * anchor;
    normal.diagonal().array() += 1e-9 * anchor;
    const Eigen::VectorXd twists = normal.ldlt().solve(right);
    if (!twists.allFinite()) return fail(ErrorCode::NotConverged, "the matching points do not fix the poses");
    double moved = 0;
    for (std::size_t i = 0; i < poses.size(); ++i) {
      const Eigen::Matrix<double, 6, 1> twist = twists.segment<6>(static_cast<Eigen::Index>(6 * i));
      poses[i] = Eigen::Translation3d{middle} * moved_by(twist, RigidMotion::Identity()) *
                 Eigen::Translation3d{-middle} * poses[i];
      poses[i].linear() = Eigen::Quaterniond{poses[i].linear()}.normalized().toRotationMatrix();
      moved = std::max(moved, twist.tail<3>().norm());
    }
    const bool converged = reach <= options.last_reach && moved < 0.002 * options.last_reach;
    if (converged || round + 1 >= options.max_rounds) return matches;
    reach = std::max(options.last_reach, reach * 0.75);
  }
}

std::optional<double> conflict_share(std::span<const RangeImage> views, std::span<const RigidMotion> poses,
                                     double clearance) {
  FreeSpace found;
  for (std::size_t j = 0; j < views.size(); ++j)
    for (std::size_t i = 0; i < views.size(); ++i) {
      if (i == j) continue;
      const std::size_t step = std::max<std::size_t>(1, views[i].points.size() / 1000);
      found += judge_points(views[i].points, views[i].weight, step, poses[j].inverse() * poses[i], views[j], clearance);
    }
  return found.conflict();
}

}  // namespace telefab::scan
