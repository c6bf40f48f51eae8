// SPDX-License-Identifier: GPL-3.0-or-later
#include <telefab/scan/completion/sheet.hpp>

#include <algorithm>
#include <cmath>

#include "rims.hpp"

namespace telefab::scan {
namespace {

/// A place of the back is this near to its thickness behind the nearest sample of the front.
constexpr float kOffsetShare = 0.95F;

}  // namespace

Result<std::vector<VirtualSample>> other_side_of_sheet(const PointCloud& front, double thickness, double noise,
                                                       std::stop_token stop) {
  if (front.points.empty() || front.normals.size() != front.size())
    return fail(ErrorCode::InvalidInput, "a sheet needs normals, to know which side is its back");
  const KdTree near{front.points};
  const auto around = look_around(near, front.points, front.normals, stop);
  if (!around) return tl::unexpected{around.error()};
  const float spacing = around->median_spacing();
  if (!(spacing > 0)) return std::vector<VirtualSample>{};
  const auto rims = find_rims(near, front.points, front.normals, *around,
                              RimReach::at_noise(noise / static_cast<double>(spacing)), stop);
  if (!rims) return tl::unexpected{rims.error()};

  const auto depth = static_cast<float>(thickness);
  std::vector<VirtualSample> made;
  const auto add = [&](const Eigen::Vector3f& place, const Eigen::Vector3f& normal, std::size_t sample) {
    made.push_back({.point = place, .normal = normal, .spacing = around->spacing[sample]});
  };
  for (std::size_t i = 0; i < front.size(); ++i) {
    const Eigen::Vector3f place = front.points[i] - depth * front.normals[i];
    if (std::sqrt(near.nearest(place).squared_distance) >= kOffsetShare * depth) add(place, -front.normals[i], i);
  }
  for (const Rim& rim : *rims) {
    const Eigen::Vector3f& edge = front.points[rim.sample];
    const Eigen::Vector3f& normal = front.normals[rim.sample];
    const Eigen::Vector3f beyond = rim.probe - edge;
    const Eigen::Vector3f outward = beyond - beyond.dot(normal) * normal;
    if (!(outward.norm() > 0)) continue;
    const float rows = std::max(2.0F, std::round(depth / around->spacing[rim.sample]));
    for (float row = 1; row < rows; ++row) add(edge - depth * row / rows * normal, outward.normalized(), rim.sample);
  }
  return made;
}

}  // namespace telefab::scan
