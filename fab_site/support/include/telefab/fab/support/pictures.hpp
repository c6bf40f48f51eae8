// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <string>
#include <telefab/fab/support/support_plan.hpp>
#include <telefab/image/frame.hpp>

namespace telefab::fab {

/// Pictures are at most this wide and high.
inline constexpr std::uint32_t kPictureSide = 1400;

/// An anchor as one layer sees it.
struct SeenAnchor {
  Point2 place;
  double reach_mm = 0;    ///< in the plane of the layer
  bool standing = false;  ///< it came with a layer below
};

/// The anchors that hold one layer of the part: its own, and those of layers below that still reach it.
[[nodiscard]] std::vector<SeenAnchor> anchors_at(const SupportPlan& plan, LayerIndex part_layer, double thickness_mm,
                                                 Millimetres anchor_distance);

/// One layer as in the paper's Figures 16 and 17: attached grey, self-supported blue, to support orange; its own
/// anchors as full dots, those that stand from below as open ones, with the circles they reach. Here and below
/// `caption` says whose picture it is; legend, scale and axes are filled in.
[[nodiscard]] Image draw_layer(const LayerRegions& regions, std::span<const SeenAnchor> anchors,
                               PictureCaption caption);

/// A covering alone: the region, the anchors and their circles.
[[nodiscard]] Image draw_covering(const Region& region, std::span<const Point2> anchors, Millimetres anchor_distance,
                                  PictureCaption caption);

/// Part (grey) and supports (orange) on the platform in 3-D, from usual_viewpoint(), with light, shadows and a grid of
/// 10 mm (1 mm under prints below 30 mm). RGB, at most kPictureSide a side, and its frame. Threads: oneTBB.
[[nodiscard]] Image draw_structure(std::span<const Layer> part, const SupportPlan& plan, double thickness_mm,
                                   PictureCaption caption);

/// The same, pins in colours from blue to red by what their tips bear as planned, over `most_demand`, what they may
/// bear; with a legend below.
[[nodiscard]] Image draw_stress(std::span<const Layer> part, const SupportPlan& plan, double thickness_mm,
                                double most_demand, PictureCaption caption);

/// The polygons of a GeoJSON text, in millimetres: Polygon, MultiPolygon, GeometryCollection, Feature and
/// FeatureCollection. Fails with InvalidInput and says where.
[[nodiscard]] Result<Region> region_from_geojson(std::string_view text);

}  // namespace telefab::fab
