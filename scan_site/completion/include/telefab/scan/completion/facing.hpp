// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <span>
#include <telefab/scan/completion/complete_cloud.hpp>
#include <telefab/scan/completion/winding_tree.hpp>
#include <vector>

namespace telefab::scan {

/// Two places of the completed surface that look at each other through air, as the ends of a limb do that was cut
/// through. Nobody measured whether the object is parted there. Relative to the origin of the cloud.
struct FacingPair {
  Eigen::Vector3f from = Eigen::Vector3f::Zero();
  Eigen::Vector3f to = Eigen::Vector3f::Zero();
};

/// For every virtual sample the other that faces it with nothing but air between them, if they are nearer to each other
/// than `most_gaps` times the sum of their gaps: of several the nearest by that measure. In the order of the samples.
/// `all`: measured and virtual samples. Parallel; same bytes on any number of threads.
[[nodiscard]] std::vector<FacingPair> facing_pairs(std::span<const VirtualSample> samples, const WindingTree& all,
                                                   float most_gaps);

}  // namespace telefab::scan
