// SPDX-License-Identifier: GPL-3.0-or-later
#include "view_group.hpp"

namespace telefab::scan {
namespace {

constexpr float kLeastWeight = 0.1F;  ///< what merging the views leaves out does not count here either

}  // namespace

ViewGroup::ViewGroup(const ViewSet& set, std::vector<std::size_t> members, std::vector<RigidMotion> poses)
    : members_{std::move(members)}, poses_{std::move(poses)} {
  OrientedPoints all;
  for (std::size_t m = 0; m < members_.size(); ++m) {
    const RangeImage& view = set.views[members_[m]];
    const Eigen::Matrix3d turn = poses_[m].rotation();
    for (std::size_t i = 0; i < view.points.size(); ++i) {
      if (view.weight[i] < kLeastWeight) continue;
      all.points.push_back((poses_[m] * view.points[i].cast<double>()).cast<float>());
      all.normals.push_back((turn * view.normals[i].cast<double>()).cast<float>());
    }
  }
  surface_ = std::make_unique<OrientedPoints>(cell_means(all, set.spacing));
  for (const Eigen::Vector3f& p : surface_->points)
    middle_ += p.cast<double>() / static_cast<double>(surface_->points.size());
  target_ = std::make_unique<AlignTarget>(surface_->points, surface_->normals);
}

ViewGroup united(const ViewSet& set, const ViewGroup& a, const ViewGroup& b, const RigidMotion& b_to_a) {
  std::vector<std::size_t> members = a.members();
  std::vector<RigidMotion> poses = a.poses();
  members.insert(members.end(), b.members().begin(), b.members().end());
  for (const RigidMotion& pose : b.poses()) poses.push_back(b_to_a * pose);
  return {set, std::move(members), std::move(poses)};
}

}  // namespace telefab::scan
