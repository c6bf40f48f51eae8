// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <string>
#include <string_view>
#include <telefab/base/result.hpp>
#include <telefab/scan/registration/align.hpp>
#include <vector>

namespace telefab::scan {

struct NamedPose {
  std::string file;  ///< as the pose file names it
  RigidMotion pose;  ///< view to common frame
};

/// Reads the `bmesh FILE tx ty tz qx qy qz qw` lines of a Stanford .conf file; `camera` and `mesh` lines are skipped.
/// The point in the common frame is R p + t with R the rotation of the CONJUGATE quaternion: that is how the published
/// files fit. Fails: InvalidInput, naming the line.
[[nodiscard]] Result<std::vector<NamedPose>> read_pose_file(std::string_view text);

/// The same form back, so that other programs can read our poses.
[[nodiscard]] std::string to_pose_file(std::span<const NamedPose> poses);

}  // namespace telefab::scan
