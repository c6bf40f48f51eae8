// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <Eigen/Core>
#include <cstdint>
#include <span>
#include <stop_token>
#include <telefab/base/result.hpp>
#include <telefab/scan/cloud/kd_tree.hpp>
#include <vector>

namespace telefab::scan {

/// What the neighbours of every sample tell.
struct Surroundings {
  std::vector<float> area;               ///< each stands for
  std::vector<float> spacing;            ///< sqrt of the mean area of the sample and its neighbours
  std::vector<std::uint8_t> may_be_rim;  ///< 0: its nearest neighbours lie all around it
  /// Of at least one sample.
  [[nodiscard]] float median_spacing() const;
};
/// The area one sample of the tree stands for.
[[nodiscard]] float area_of(const KdTree& near, std::span<const Eigen::Vector3f> points,
                            std::span<const Eigen::Vector3f> normals, std::uint32_t sample);
[[nodiscard]] Result<Surroundings> look_around(const KdTree& near, std::span<const Eigen::Vector3f> points,
                                               std::span<const Eigen::Vector3f> normals, std::stop_token stop);

/// Lengths in spacings about a rim.
struct RimReach {
  float covered = 1.4F;  ///< a place nearer than this to a sample is covered by it
  float probe = 1.8F;    ///< how far beyond a rim it is looked
  /// Noise takes samples away from their neighbours.
  [[nodiscard]] static RimReach at_noise(double noise_spacings);
};

/// A place just beyond a sample where the surface ends.
struct Rim {
  std::uint32_t sample = 0;
  Eigen::Vector3f probe = Eigen::Vector3f::Zero();
};
/// In the order of the samples.
[[nodiscard]] Result<std::vector<Rim>> find_rims(const KdTree& near, std::span<const Eigen::Vector3f> points,
                                                 std::span<const Eigen::Vector3f> normals, const Surroundings& around,
                                                 const RimReach& reach, std::stop_token stop);

}  // namespace telefab::scan
