// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <memory>
#include <span>
#include <telefab/scan/registration/align.hpp>
#include <telefab/scan/registration/range_image.hpp>
#include <vector>

#include "coarse_pose.hpp"

namespace telefab::scan {

/// All views of a call, each with its tree. The spans must live on.
struct ViewSet {
  std::span<const RangeImage> views;
  std::span<const AlignTarget> targets;
  double spacing = 0;  ///< the coarsest of the views'
};

/// Views that keep their places to each other, as one body that can be moved. Move only.
class ViewGroup {
 public:
  /// `poses`: view to the frame of the group, one a member.
  ViewGroup(const ViewSet& set, std::vector<std::size_t> members, std::vector<RigidMotion> poses);

  [[nodiscard]] const std::vector<std::size_t>& members() const { return members_; }
  [[nodiscard]] const std::vector<RigidMotion>& poses() const { return poses_; }
  /// Means over cubes of one spacing, frame of the group.
  [[nodiscard]] const OrientedPoints& surface() const { return *surface_; }
  [[nodiscard]] const AlignTarget& target() const { return *target_; }
  [[nodiscard]] const Vec3& middle() const { return middle_; }

 private:
  std::vector<std::size_t> members_;
  std::vector<RigidMotion> poses_;
  std::unique_ptr<OrientedPoints> surface_;  ///< on the heap: the target views it
  std::unique_ptr<AlignTarget> target_;
  Vec3 middle_ = Vec3::Zero();
};

/// `b` moved by `b_to_a` and put to `a`.
[[nodiscard]] ViewGroup united(const ViewSet& set, const ViewGroup& a, const ViewGroup& b, const RigidMotion& b_to_a);

}  // namespace telefab::scan
