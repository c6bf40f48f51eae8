// SPDX-License-Identifier: GPL-3.0-or-later
#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <telefab/fab/support/pictures.hpp>
#include <telefab/image/palette.hpp>

namespace telefab::fab {
namespace {

using palette::kAttached, palette::kSelfSupported, palette::kToSupport, palette::kAnchor, palette::kPaper;
constexpr Colour kCircle = palette::kAnchor, kPaleCircle = palette::kPaleInk, kEdge = palette::kPaleInk;

/// Millimetres to pixels of a picture that holds a box with a margin; y upwards.
struct View {
  Bounds2 box;
  double scale = 1;
  std::uint32_t width = 1, height = 1;

  View(Bounds2 around, double margin_mm) : box{around} {
    box.min = {box.min.x_mm - margin_mm, box.min.y_mm - margin_mm};
    box.max = {box.max.x_mm + margin_mm, box.max.y_mm + margin_mm};
    const double w = std::max(1e-6, box.max.x_mm - box.min.x_mm), h = std::max(1e-6, box.max.y_mm - box.min.y_mm);
    scale = kPictureSide / std::max(w, h);
    width = static_cast<std::uint32_t>(std::max(16.0, std::ceil(w * scale)));
    height = static_cast<std::uint32_t>(std::max(16.0, std::ceil(h * scale)));
  }
  [[nodiscard]] PixelPoint at(Point2 p) const {
    return {(p.x_mm - box.min.x_mm) * scale, (box.max.y_mm - p.y_mm) * scale};
  }
  [[nodiscard]] std::vector<std::vector<PixelPoint>> rings(const Region& region) const {
    std::vector<std::vector<PixelPoint>> out;
    for (const GridRing& ring : region.rings()) {
      std::vector<PixelPoint> points;
      for (const GridPoint& p : ring) points.push_back(at(to_mm(p)));
      out.push_back(std::move(points));
    }
    return out;
  }
};

void fill(Canvas& canvas, const View& view, const Region& region, Colour colour) {
  if (!region.empty()) canvas.fill(view.rings(region), colour);
}

void mark(Canvas& canvas, const View& view, std::span<const Point2> anchors, Millimetres reach) {
  for (const Point2& a : anchors) canvas.circle(view.at(a), reach.count() * view.scale, kCircle, 1);
  for (const Point2& a : anchors) canvas.disc(view.at(a), 4, kAnchor);
}

}  // namespace

std::vector<SeenAnchor> anchors_at(const SupportPlan& plan, LayerIndex part_layer, double thickness_mm,
                                   Millimetres anchor_distance) {
  std::vector<SeenAnchor> seen;
  const double reach = anchor_distance.count();
  for (const Anchor& a : plan.anchors()) {
    if (a.layer > part_layer) continue;
    const double rise = (part_layer.count() - a.layer.count()) * thickness_mm;
    if (rise < reach) seen.push_back({a.place, std::sqrt(reach * reach - rise * rise), a.layer < part_layer});
  }
  return seen;
}

Image draw_layer(const LayerRegions& regions, std::span<const SeenAnchor> anchors, PictureCaption caption) {
  const Region parts[] = {regions.attached, regions.self_supported, regions.to_support};
  double reach = 0;
  for (const SeenAnchor& a : anchors) reach = std::max(reach, a.reach_mm);
  const Region whole = unite(parts);
  const Bounds2 box = whole.bounds();
  const double side = std::max(box.max.x_mm - box.min.x_mm, box.max.y_mm - box.min.y_mm);
  const View view{box, std::max(reach, 0.04 * side)};
  Canvas canvas{view.width, view.height, kPaper};
  fill(canvas, view, regions.self_supported, kSelfSupported);
  fill(canvas, view, regions.attached, kAttached);
  fill(canvas, view, regions.to_support, kToSupport);
  for (const auto& ring : view.rings(whole)) canvas.outline(ring, kEdge, 1);
  // Only anchors in material of this layer say something about it.
  std::vector<SeenAnchor> shown;
  for (const SeenAnchor& a : anchors)
    if (whole.contains(a.place)) shown.push_back(a);
  for (const SeenAnchor& a : shown)
    canvas.circle(view.at(a.place), a.reach_mm * view.scale, a.standing ? kPaleCircle : kCircle, a.standing ? 1 : 2);
  for (const SeenAnchor& a : shown) {
    canvas.disc(view.at(a.place), 5, a.standing ? kPaleCircle : kAnchor);
    if (a.standing) canvas.disc(view.at(a.place), 3.2, kPaper);
  }
  caption.legend = {{kAttached, "attached", LegendMark::Area},
                    {kSelfSupported, "self-supported", LegendMark::Area},
                    {kToSupport, "to support", LegendMark::Area},
                    {kAnchor, "anchor of this layer, and how far it reaches", LegendMark::Disc},
                    {kPaleCircle, "anchor standing from below", LegendMark::Ring}};
  caption.px_per_mm = view.scale;
  caption.axes = axes_of_plane();
  return framed(canvas.image(), caption);
}

Image draw_covering(const Region& region, std::span<const Point2> anchors, Millimetres anchor_distance,
                    PictureCaption caption) {
  const View view{region.bounds(), 1.05 * anchor_distance.count()};
  Canvas canvas{view.width, view.height, kPaper};
  fill(canvas, view, region, kToSupport);
  mark(canvas, view, anchors, anchor_distance);
  caption.legend = {{kToSupport, "to support", LegendMark::Area},
                    {kAnchor, "anchor, and how far it reaches", LegendMark::Disc}};
  caption.px_per_mm = view.scale;
  caption.axes = axes_of_plane();
  return framed(canvas.image(), caption);
}

}  // namespace telefab::fab
