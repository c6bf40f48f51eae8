// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <telefab/scan/completion/complete_cloud.hpp>
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

/// From the rims along the zero set of the distance that all samples agree on, cell by cell, until samples cover the
/// surface again. Fills samples, too_wide, too_many.
[[nodiscard]] Result<void> follow_surface(const MeasuredSide& measured, std::span<const Rim> rims,
                                          const RimReach& reach, float most_gap, std::size_t most_samples,
                                          Completion& completion, const ProgressSink& progress, std::stop_token stop);

}  // namespace telefab::scan
