// SPDX-License-Identifier: GPL-3.0-or-later
#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <telefab/fab/support/pictures.hpp>
#include <telefab/image/canvas.hpp>

namespace telefab::fab {
namespace {

constexpr Colour kPaper{255, 255, 255}, kAttached{196, 200, 206}, kSelf{150, 205, 150}, kToSupport{228, 110, 96},
    kAnchor{30, 40, 60}, kCircle{70, 110, 190}, kPaleCircle{150, 165, 195}, kEdge{120, 124, 132}, kInk{40, 46, 58};

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

Image draw_layer(const LayerRegions& regions, std::span<const SeenAnchor> anchors) {
  const Region parts[] = {regions.attached, regions.self_supported, regions.to_support};
  double reach = 0;
  for (const SeenAnchor& a : anchors) reach = std::max(reach, a.reach_mm);
  const Region whole = unite(parts);
  const Bounds2 box = whole.bounds();
  const double side = std::max(box.max.x_mm - box.min.x_mm, box.max.y_mm - box.min.y_mm);
  const View view{box, std::max(reach, 0.04 * side)};
  constexpr std::uint32_t kLegend = 84;
  Canvas canvas{std::max(view.width, 1080U), view.height + kLegend, kPaper};
  fill(canvas, view, regions.self_supported, kSelf);
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
  const double y = view.height + 30.0;
  double x = 24;
  const auto entry = [&](std::string_view text) {
    canvas.text({x + 28, y + 6}, text, kInk, 17);
    x += 58 + 12.5 * static_cast<double>(text.size());
  };
  for (const auto& [colour, text] : {std::pair<Colour, std::string_view>{kAttached, "attached"},
                                     {kSelf, "self-supported"},
                                     {kToSupport, "to support"}}) {
    const std::vector<PixelPoint> square{{x, y - 9}, {x + 18, y - 9}, {x + 18, y + 9}, {x, y + 9}};
    canvas.fill(std::span{&square, 1}, colour);
    canvas.outline(square, kEdge, 1);
    entry(text);
  }
  canvas.disc({x + 9, y}, 5, kAnchor);
  entry("anchor of this layer");
  canvas.disc({x + 9, y}, 5, kPaleCircle);
  canvas.disc({x + 9, y}, 3.2, kPaper);
  entry("standing from below");
  // A length of 1, 2 or 5 times a power of ten, about a sixth of the picture.
  const double wanted = view.width / view.scale / 6, power = std::pow(10, std::floor(std::log10(wanted)));
  const double length = power * (wanted >= 5 * power ? 5 : wanted >= 2 * power ? 2 : 1);
  const double from = 24, to = from + length * view.scale;
  canvas.line({from, y + 34}, {to, y + 34}, kInk, 2);
  for (const double end : {from, to}) canvas.line({end, y + 28}, {end, y + 40}, kInk, 2);
  canvas.text({to + 12, y + 40}, fmt::format("{:g} mm", length), kInk, 17);
  return canvas.image();
}

Image draw_covering(const Region& region, std::span<const Point2> anchors, Millimetres anchor_distance) {
  const View view{region.bounds(), 0.6 * anchor_distance.count()};
  Canvas canvas{view.width, view.height, kPaper};
  fill(canvas, view, region, kToSupport);
  mark(canvas, view, anchors, anchor_distance);
  return canvas.image();
}

}  // namespace telefab::fab
