// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <optional>
#include <stop_token>
#include <telefab/base/result.hpp>
#include <telefab/scan/formats/read_cloud.hpp>

namespace telefab::scan {

/// Whether the faces of a mesh file carry no points, as those of CAD programs do: a sentence that says so. Nothing for
/// files without faces, and for meshes whose corners are samples of their surface.
[[nodiscard]] std::optional<ScanNote> faces_without_points(const ScanFile& file);

/// Points spread evenly over the faces (none nearer to another than about the spacing), each with the normal of its
/// face: a cloud as a scanner would give it. 100,000 to 400,000 points, so that the thinnest side has some 60 where
/// that suffices. Faces are forgotten: what is sliced are the points. Fails: InvalidInput (no faces, no area),
/// Cancelled.
[[nodiscard]] Result<PointCloud> sample_faces(const ScanFile& file, std::stop_token stop);

}  // namespace telefab::scan
