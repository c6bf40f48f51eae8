// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <telefab/base/result.hpp>
#include <telefab/scan/cloud/point_cloud.hpp>

#include <telefab/test/mesh_truth.hpp>

namespace telefab::test {

/// Corners and the faces between them.
struct FaceSet {
  std::vector<Vec3> corners;
  std::vector<std::array<std::uint32_t, 3>> faces;
};

/// What a user would do instead: screened Poisson reconstruction of this depth (1 to 12) and point weight 4 with the
/// normals as given, by PCL. A yardstick; no program of Telefab contains it. Fails: InvalidInput (a cloud without
/// normals), NotFound where the build found no PCL, Internal where it gives no faces.
[[nodiscard]] Result<FaceSet> poisson_faces(const scan::PointCloud& cloud, int depth = 8);

}  // namespace telefab::test
