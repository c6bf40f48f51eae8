// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <telefab/geometry/layer.hpp>
#include <telefab/scan/cloud/point_cloud.hpp>
#include <telefab/scan/slicing/slice_scan.hpp>

namespace telefab::scan {

struct Placement {
  PointCloud cloud;  ///< build frame, millimetres
  Transform4 scan_to_build = kIdentity4;
  Vec3 size_mm = Vec3::Zero();
  Vec3 middle_mm = Vec3::Zero();             ///< of the box; the cloud's coordinates are relative to it
  PlacementOptions options;                  ///< as asked for, axis_scale with what makes good shrinkage
  std::optional<std::string> scale_warning;  ///< nobody stated a size, and the one it has looks wrong
  bool unit_is_stated = false;               ///< by the file or the request
};

/// Mirrors, turns, scales and moves the scan onto the platform: where it is wanted or in the middle, lowest point at
/// z = 0. Fails: InvalidInput (no points, no extent, larger than the platform or the Z travel: the message has both
/// sizes and the height that would fit, and the unit the file may be in; a position from which it leaves the platform:
/// the message has the room there is).
[[nodiscard]] Result<Placement> place_on_platform(PointCloud scan, const SliceRequest& request);

}  // namespace telefab::scan
