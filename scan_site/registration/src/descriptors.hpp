// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <Eigen/Core>
#include <span>
#include <telefab/scan/cloud/kd_tree.hpp>

namespace telefab::scan {

inline constexpr Eigen::Index kDescriptorLength = 33;
/// One column a point.
using Descriptors = Eigen::Matrix<float, kDescriptorLength, Eigen::Dynamic>;

/// Fast Point Feature Histograms (Rusu, Blodow, Beetz 2009) over all neighbours within `radius`, with the normals
/// given. A point without neighbours has the zero column. `tree` holds the same points. Same bytes on any number of
/// threads.
[[nodiscard]] Descriptors describe_points(std::span<const Eigen::Vector3f> points,
                                          std::span<const Eigen::Vector3f> normals, const KdTree& tree, float radius);

}  // namespace telefab::scan
