#pragma once
#include <string>
#include <telefab/fab/support/support_plan.hpp>
#include <telefab/image/png.hpp>

namespace telefab::fab {

/// Pictures are at most this wide and high.
inline constexpr std::uint32_t kPictureSide = 1400;

/// One layer as in the paper's Figures 16 and 17: attached grey, self-supported green, to support red, anchors as dots
/// with the circle they reach.
[[nodiscard]] Image draw_layer(const LayerRegions& regions, std::span<const Point2> anchors,
                               Millimetres anchor_distance);

/// A covering alone: the region, the anchors and their circles.
[[nodiscard]] Image draw_covering(const Region& region, std::span<const Point2> anchors, Millimetres anchor_distance);

/// Part (grey) and supports (orange) in 3-D, seen from a little below the horizon's 20 degrees; shaded voxels.
[[nodiscard]] Image draw_structure(std::span<const Layer> part, const SupportPlan& plan, double thickness_mm);

/// Part and supports as a binary PLY mesh with a colour at every vertex, for any viewer: sticks and plates as closed
/// solids, the part as the walls of its layers.
[[nodiscard]] std::string structure_ply(std::span<const Layer> part, const SupportPlan& plan, double thickness_mm,
                                        Millimetres tolerance);

/// The polygons of a GeoJSON text, in millimetres: Polygon, MultiPolygon, GeometryCollection, Feature and
/// FeatureCollection. Fails with InvalidInput and says where.
[[nodiscard]] Result<Region> region_from_geojson(std::string_view text);

}  // namespace telefab::fab
