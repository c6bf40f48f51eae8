// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <telefab/scan/completion/winding_tree.hpp>

#include "rims.hpp"

namespace telefab::scan {

/// The measured samples as a gap sees them.
struct MeasuredSide {
  std::span<const Eigen::Vector3f> points;
  std::span<const Eigen::Vector3f> normals;
  std::span<const float> areas;
  std::span<const float> spacings;  ///< smooth
  const KdTree& near;
  const WindingTree& tree;
  float spacing = 0;  ///< median of them
};

}  // namespace telefab::scan
