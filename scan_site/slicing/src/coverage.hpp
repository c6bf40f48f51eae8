// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <cstddef>
#include <functional>
#include <optional>
#include <span>
#include <telefab/geometry/contour.hpp>
#include <telefab/scan/mls/mls_field.hpp>

namespace telefab::scan {

/// Samples with low <= z <= high, rising in z.
using SampleSource = std::function<void(double low_mm, double high_mm, SurfaceSamples& found)>;

/// How the samples near a plane agree with the contours found in it.
struct Coverage {
  std::size_t lost = 0;         ///< samples whose surface, followed to the plane, meets no contour there
  std::size_t unexplained = 0;  ///< samples that no surface of the field passes: of a feature it lost
  std::vector<Point2> places;   ///< of the lost samples, then of the unexplained ones
};

/// Holds the samples near the plane z against its contours. A sample beside which no contour of like orientation runs,
/// by its own tangent plane, within `reach_kernels` of the local kernel, is set down on the field's surface and
/// followed along it, straight up or down, to the plane: there a contour must pass. Where the surface turns level on
/// the way it ends at a critical point and says nothing. A sample may lie off the surface by a quarter of a kernel and
/// four times the noise. One that no surface passes counts where `all`
/// have others beside it; without them always. `samples` rise in z, steep ones only.
[[nodiscard]] Coverage coverage_of(const ScalarField& field, FieldCursor& cursor, double z_mm,
                                   std::span<const Contour> contours, const SurfaceSamples& samples,
                                   double reach_kernels, double noise_mm, const SampleSource& all);

/// Whether the field's surface passes the samples both below and above the plane: something must be cut there.
/// Samples that no surface passes do not count.
[[nodiscard]] bool straddles(const ScalarField& field, FieldCursor& cursor, double z_mm, const SurfaceSamples& samples);

}  // namespace telefab::scan
