// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <telefab/base/result.hpp>
#include <telefab/scan/cloud/point_cloud.hpp>

#include <telefab/test/mesh_truth.hpp>

namespace telefab::test {

/// What a user would do instead: screened Poisson reconstruction of depth 8 and point weight 4 with the normals as
/// given, by PCL. A yardstick for this campaign; no program of Telefab contains it. Fails: InvalidInput (a cloud
/// without normals), NotFound where the campaign was built without PCL, Internal where it gives no faces.
[[nodiscard]] Result<MeshTruth> poisson_mesh(const scan::PointCloud& cloud);

}  // namespace telefab::test
