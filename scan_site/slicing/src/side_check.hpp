// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <optional>
#include <span>
#include <telefab/geometry/contour.hpp>
#include <telefab/scan/mls/mls_field.hpp>

#include "completed_scan.hpp"

namespace telefab::scan {

/// Asks of a layer's contours what knows nothing of the field they were traced in: the winding number of all samples
/// must exceed one half inside of them and stay below it outside, at places less than a kernel width apart all around
/// the samples near the plane. A place where it does not; none where both tell the same. What is narrower than a kernel
/// width is not seen: ask `narrow_passage` as well.
[[nodiscard]] std::optional<Point2> contradicted_side(const CompletedScan& scan, const ScalarField& field,
                                                      std::span<const Contour> contours, double z_mm,
                                                      const SurfaceSamples& near);

/// A place where two stretches of contour, wherever else they run, are nearer to each other than a kernel width:
/// whether they join or pass is then a matter of the kernel and not of the samples. None where all keep that distance.
[[nodiscard]] std::optional<Point2> narrow_passage(const ScalarField& field, std::span<const Contour> contours,
                                                   double z_mm);

}  // namespace telefab::scan
