// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <telefab/scan/mls/mls_field.hpp>

#include "mls_cursor.hpp"

namespace telefab::scan {

/// A field made ready: samples sorted, outliers left out, widths chosen.
struct FieldSetup {
  FieldParts field;
  KernelChoice choice;
  Box3 bounds;
};

/// What MlsField::from_cloud does. Peak of memory: 40 bytes a point, 24 of them the cloud's own, and where the widths
/// vary 24 more while the samples are parted by width.
[[nodiscard]] Result<FieldSetup> set_up_field(PointCloud placed, const MlsOptions& options, std::stop_token stop);

/// The same samples with kernels `factor` times as wide.
[[nodiscard]] FieldSetup with_scaled_kernel(const FieldSetup& setup, double factor);

/// The same samples and others in their gaps, in bands of their own; choice and measured bands stay as they are.
[[nodiscard]] FieldSetup completed_by(const FieldSetup& setup, std::span<const GapSample> others);

}  // namespace telefab::scan
