// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <Eigen/Geometry>
#include <memory>
#include <span>
#include <stop_token>
#include <telefab/base/result.hpp>
#include <telefab/scan/cloud/kd_tree.hpp>
#include <telefab/scan/cloud/point_cloud.hpp>
#include <vector>

namespace telefab::scan {

using RigidMotion = Eigen::Isometry3d;

/// A rotation angle in degrees and a shift: how far two motions are apart, the shift taken at `at`.
struct MotionDifference {
  double degrees = 0;
  double shift = 0;
};
[[nodiscard]] MotionDifference difference(const RigidMotion& a, const RigidMotion& b, const Vec3& at);

/// The motion of a small twist (rotation vector, shift), applied before `to`.
[[nodiscard]] RigidMotion moved_by(const Eigen::Matrix<double, 6, 1>& twist, const RigidMotion& to);

/// Points with normals that others are fitted to. Views the spans: they must live on.
class AlignTarget {
 public:
  AlignTarget(std::span<const Eigen::Vector3f> at, std::span<const Eigen::Vector3f> facing)
      : points{at}, normals{facing}, tree{at} {}
  std::span<const Eigen::Vector3f> points;
  std::span<const Eigen::Vector3f> normals;
  KdTree tree;
};

/// One pair of matching points, both in the world's frame.
struct Match {
  Vec3 source;
  Vec3 target;
  Vec3 normal;  ///< of the target
  double weight = 1;
  [[nodiscard]] double offset() const { return normal.dot(source - target); }
};

/// Pairs every `step`-th source point with its nearest target point; far pairs and pairs whose normals differ by
/// more than 60 degrees are rejected. `usable` (empty = all) has a weight a target point; 0 rejects.
[[nodiscard]] std::vector<Match> find_matches(std::span<const Eigen::Vector3f> points,
                                              std::span<const Eigen::Vector3f> normals, std::span<const float> weights,
                                              const RigidMotion& source_to_world, const AlignTarget& target,
                                              std::span<const float> usable, const RigidMotion& target_to_world,
                                              double max_distance, std::size_t step);

/// Root of the weighted mean square of the matches' offsets.
[[nodiscard]] double rms_of(std::span<const Match> matches);

struct AlignOptions {
  double first_distance = 0;   ///< > 0; pairs farther apart are rejected at the start, unit of the points
  double last_distance = 0;    ///< > 0; and at the end
  int max_rounds = 60;         ///< [1, 1000]
  std::size_t samples = 4000;  ///< >= 100; source points used
};
struct Alignment {
  RigidMotion motion = RigidMotion::Identity();  ///< source to target
  double rms = 0;                                ///< point to plane, of the pairs kept, unit of the points
  double overlap = 0;                            ///< share of the source points that kept a pair
  int rounds = 0;
};
/// Point-to-plane ICP from `start` with shrinking rejection and Tukey weights. Deterministic.
/// Fails: NotConverged (too few pairs, singular), Cancelled.
[[nodiscard]] Result<Alignment> align(std::span<const Eigen::Vector3f> points, std::span<const Eigen::Vector3f> normals,
                                      const AlignTarget& target, const RigidMotion& start, const AlignOptions& options,
                                      std::stop_token stop);

}  // namespace telefab::scan
