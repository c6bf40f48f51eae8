// SPDX-License-Identifier: GPL-3.0-or-later
#include "poisson.hpp"

namespace telefab::campaign {

Result<MeshTruth> poisson_mesh(const scan::PointCloud&) {
  return fail(ErrorCode::NotFound, "this campaign was built without PCL (package libpcl-dev)");
}

}  // namespace telefab::campaign
