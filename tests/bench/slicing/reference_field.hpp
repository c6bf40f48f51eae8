// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <memory>
#include <telefab/scan/cloud/point_cloud.hpp>
#include <telefab/scan/mls/scalar_field.hpp>

namespace telefab::bench {

/// The unbiased surface as one would write it first: nanoflann radius search for every evaluation, double, scalar
/// exp. The same surface as MlsField's with one kernel width; what the fast one is measured against.
[[nodiscard]] std::unique_ptr<scan::ScalarField> reference_field(const scan::PointCloud& cloud, double kernel_mm);

}  // namespace telefab::bench
