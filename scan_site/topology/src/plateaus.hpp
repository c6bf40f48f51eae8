// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <telefab/scan/topology/height_topology.hpp>

namespace telefab::scan::topology {

/// A place of the surface that is level there, within 10 degrees.
struct LevelPlace {
  Vec3 at;
  bool up = false;  ///< as its normal looks
};
/// Of these starts of the search those that are level by the field, moved onto the surface, in their order.
[[nodiscard]] std::vector<LevelPlace> level_places(const ScalarField& field, std::span<const Vec3> starts);

/// Critical points that belong together because the surface between them is level within the kernel: at least four
/// in one level place with heights a chain of small gaps, or one without bend. Marks them and returns the plateaus,
/// lowest first.
[[nodiscard]] std::vector<Plateau> gather_plateaus(const ScalarField& field, std::span<const LevelPlace> level,
                                                   std::vector<CriticalPoint>& points, double gap_kernels);

/// Points of the surface piece around a plateau: samples moved onto the surface, between the two heights, connected
/// to its critical points by others.
[[nodiscard]] std::vector<Vec3> points_around(const ScalarField& field, FieldCursor& cursor,
                                              std::span<const Vec3> samples, std::span<const Vec3> normals,
                                              std::span<const CriticalPoint> points,
                                              std::span<const std::size_t> members, double low_mm, double high_mm);

}  // namespace telefab::scan::topology
