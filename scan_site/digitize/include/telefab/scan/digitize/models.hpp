// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <string_view>
#include <telefab/base/result.hpp>
#include <telefab/scan/cloud/point_cloud.hpp>
#include <telefab/scan/digitize/digitize.hpp>

namespace telefab::scan {

/// A closed surface given by a formula, as fine triangles, standing on z = 0 about the z axis: "sphere", "torus"
/// (upright) or "knot" (a tube along a trefoil). `height_mm` > 0. Facets leave the formula by less than 1e-4 of the
/// height. Fails: InvalidInput (another name).
[[nodiscard]] Result<DigitizeModel> shape_model(std::string_view name, double height_mm);

/// A surface of small squares, one a point, that overlap without gaps: what can be looked at of a cloud with normals,
/// as the part predicted by `telefab-fab predict`. Half a side is 0.6 of the distance to the sixth neighbour, so an
/// edge stands out by about half a spacing. Fails: InvalidInput (no normals, fewer than 16 points).
[[nodiscard]] Result<DigitizeModel> surfel_model(const PointCloud& cloud);

/// Turns the triangles round where all of them together enclose a negative volume, as in meshes that are inside out:
/// scanners see no surface from behind. Says whether it did.
bool face_outward(DigitizeModel& model);

/// Makes the model `height_mm` high along z, about the origin of its frame.
void scale_to_height(DigitizeModel& model, double height_mm);

/// Points evenly at random over the triangles, about one a square of side `spacing_mm`, with the triangles' normals.
/// Same seed, same points.
[[nodiscard]] PointCloud reference_cloud(const DigitizeModel& model, double spacing_mm, std::uint64_t seed);

}  // namespace telefab::scan
