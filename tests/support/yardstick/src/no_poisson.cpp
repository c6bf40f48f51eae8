// SPDX-License-Identifier: GPL-3.0-or-later
#include <telefab/test/poisson.hpp>

namespace telefab::test {

Result<FaceSet> poisson_faces(const scan::PointCloud&, int) {
  return fail(ErrorCode::NotFound, "built without PCL (package libpcl-dev)");
}

}  // namespace telefab::test
