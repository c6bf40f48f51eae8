// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <cstdint>
#include <span>
#include <stop_token>
#include <telefab/scan/registration/align.hpp>
#include <vector>

#include "descriptors.hpp"

namespace telefab::scan {

/// Points with normals.
struct OrientedPoints {
  std::vector<Eigen::Vector3f> points;
  std::vector<Eigen::Vector3f> normals;  ///< unit
};

/// The mean point and normal of every cube of side `cell` that holds points, in the order of the cubes. Cubes whose
/// normals cancel (a wall thinner than a cube, an edge) are left out.
[[nodiscard]] OrientedPoints cell_means(const OrientedPoints& from, double cell);

/// What the search for a pose needs of one shape. Move only.
class CoarseShape {
 public:
  /// `cell` > 0: side of the cubes, the same for both shapes of a search. A shape with fewer than 50 cubes finds no
  /// pose.
  CoarseShape(const OrientedPoints& from, double cell);

  [[nodiscard]] const OrientedPoints& means() const { return means_; }
  [[nodiscard]] const Descriptors& descriptors() const { return descriptors_; }
  [[nodiscard]] double cell() const { return cell_; }
  [[nodiscard]] double diagonal() const { return diagonal_; }  ///< of the box of the means
  [[nodiscard]] const Vec3& middle() const { return middle_; }
  /// Index of a mean within about two cells, or -1.
  [[nodiscard]] std::int32_t near(const Eigen::Vector3f& place) const;

 private:
  OrientedPoints means_;
  Descriptors descriptors_;
  double cell_ = 0, diagonal_ = 0;
  float grid_ = 0;  ///< side of the cubes of `nearest_`
  Vec3 middle_ = Vec3::Zero();
  Eigen::Vector3f low_ = Eigen::Vector3f::Zero();
  Eigen::Array3i size_ = Eigen::Array3i::Zero();
  std::vector<std::int32_t> nearest_;  ///< one a cube of a grid over the box and two cells about it
};

struct CoarsePose {
  RigidMotion motion = RigidMotion::Identity();  ///< source to target
  double share = 0;  ///< of the source's means that lie near one of the target's that faces the same way
};

struct CoarseOptions {
  std::uint32_t draws = 150'000;  ///< pairs of correspondences tried
  std::size_t most = 80;          ///< distinct poses kept
  std::uint64_t seed = 1;
};

/// Poses of `source` on `target`, best first, 8 degrees or three cells apart: correspondences by descriptors that are
/// in each other's best eight, two at a time, each frame they make verified at once on the means. Deterministic: same
/// shapes, options and seed, same poses on any number of threads. Empty where nothing fits.
[[nodiscard]] std::vector<CoarsePose> search_poses(const CoarseShape& source, const CoarseShape& target,
                                                   const CoarseOptions& options, const std::stop_token& stop);

}  // namespace telefab::scan
