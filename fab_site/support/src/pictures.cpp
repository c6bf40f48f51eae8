#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <telefab/fab/support/pictures.hpp>
#include <telefab/image/canvas.hpp>

namespace telefab::fab {
namespace {

constexpr Colour kPaper{255, 255, 255}, kAttached{196, 200, 206}, kSelf{150, 205, 150}, kToSupport{228, 110, 96},
    kAnchor{30, 40, 60}, kCircle{70, 110, 190};

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

Image draw_layer(const LayerRegions& regions, std::span<const Point2> anchors, Millimetres anchor_distance) {
  const Region parts[] = {regions.attached, regions.self_supported, regions.to_support};
  const View view{unite(parts).bounds(), anchor_distance.count()};
  Canvas canvas{view.width, view.height, kPaper};
  fill(canvas, view, regions.self_supported, kSelf);
  fill(canvas, view, regions.attached, kAttached);
  fill(canvas, view, regions.to_support, kToSupport);
  mark(canvas, view, anchors, anchor_distance);
  return canvas.image();
}

Image draw_covering(const Region& region, std::span<const Point2> anchors, Millimetres anchor_distance) {
  const View view{region.bounds(), 0.6 * anchor_distance.count()};
  Canvas canvas{view.width, view.height, kPaper};
  fill(canvas, view, region, kToSupport);
  mark(canvas, view, anchors, anchor_distance);
  return canvas.image();
}

Image draw_structure(std::span<const Layer> part, const SupportPlan& plan, double thickness_mm) {
  constexpr int kSide = 900;
  constexpr double kTurn = 0.6, kTilt = 0.3;  // radians: about the vertical, and down from the horizon
  const auto layers = static_cast<std::uint32_t>(part.size()) + plan.lift_layers();
  // Every layer is drawn as level scan lines into a picture with a depth; the section's run of pixels keeps its depth.
  std::vector<Region> solid(layers), pins(layers);
  std::vector<Region> boxes;
  for (std::uint32_t k = 0; k < layers; ++k) {
    pins[k] = plan.section_region(LayerIndex{k});
    if (k >= plan.lift_layers())
      solid[k] = Region::from_contours(part[k - plan.lift_layers()].contours).value_or(Region{});
    for (const Region* r : {&solid[k], &pins[k]})
      if (!r->empty()) {
        const Bounds2 b = r->bounds();
        boxes.push_back(Region::from_rings(std::vector<GridRing>{{to_grid(b.min), to_grid({b.max.x_mm, b.min.y_mm}),
                                                                  to_grid(b.max), to_grid({b.min.x_mm, b.max.y_mm})}})
                            .value_or(Region{}));
      }
  }
  const Bounds2 box = unite(boxes).bounds();
  const Point2 middle{(box.min.x_mm + box.max.x_mm) / 2, (box.min.y_mm + box.max.y_mm) / 2};
  const double radius = std::hypot(box.max.x_mm - box.min.x_mm, box.max.y_mm - box.min.y_mm) / 2 + 1e-6;
  const double tall = layers * thickness_mm;
  const double scale = kSide * 0.94 / std::max(2 * radius, tall * std::cos(kTilt) + 2 * radius * std::sin(kTilt));
  std::vector<double> depth(kSide * kSide, std::numeric_limits<double>::infinity());
  std::vector<std::uint8_t> kind(kSide * kSide, 0);
  const double step = 0.7 / scale;
  const auto splat = [&](const Region& region, double z, std::uint8_t what) {
    if (region.empty()) return;
    const Bounds2 b = region.bounds();
    for (double y = b.min.y_mm + step / 2; y < b.max.y_mm; y += step) {
      std::vector<double> at;
      for (const GridRing& ring : region.rings())
        for (std::size_t i = 0; i < ring.size(); ++i) {
          const Point2 p = to_mm(ring[i]), q = to_mm(ring[i + 1 < ring.size() ? i + 1 : 0]);
          if ((p.y_mm < y) == (q.y_mm < y)) continue;
          at.push_back(p.x_mm + (y - p.y_mm) / (q.y_mm - p.y_mm) * (q.x_mm - p.x_mm));
        }
      std::sort(at.begin(), at.end());
      for (std::size_t i = 0; i + 1 < at.size(); i += 2)
        for (double x = at[i]; x <= at[i + 1]; x += step) {
          const double dx = x - middle.x_mm, dy = y - middle.y_mm;
          const double u = dx * std::cos(kTurn) + dy * std::sin(kTurn);
          const double away = -dx * std::sin(kTurn) + dy * std::cos(kTurn);
          const double v = (z - tall / 2) * std::cos(kTilt) + away * std::sin(kTilt);
          const double far = away * std::cos(kTilt) - (z - tall / 2) * std::sin(kTilt);
          const int px = static_cast<int>(std::floor(kSide / 2.0 + u * scale));
          const int rows = std::max(1, static_cast<int>(std::ceil(thickness_mm * std::cos(kTilt) * scale)));
          for (int r = 0; r < rows; ++r) {
            const int py = static_cast<int>(std::floor(kSide / 2.0 - v * scale)) - r;
            if (px < 0 || py < 0 || px >= kSide || py >= kSide) continue;
            const auto cell = static_cast<std::size_t>(py * kSide + px);
            if (far < depth[cell]) depth[cell] = far, kind[cell] = what;
          }
        }
    }
  };
  for (std::uint32_t k = 0; k < layers; ++k) {
    splat(solid[k], k * thickness_mm, 1);
    splat(pins[k], k * thickness_mm, 2);
  }
  Image image{kSide, kSide, 3, std::vector<std::uint8_t>(kSide * kSide * 3, 255)};
  constexpr std::array<std::array<double, 3>, 3> kColours{{{255, 255, 255}, {198, 204, 214}, {240, 150, 40}}};
  for (int y = 1; y + 1 < kSide; ++y)
    for (int x = 1; x + 1 < kSide; ++x) {
      const auto cell = static_cast<std::size_t>(y * kSide + x);
      if (kind[cell] == 0) continue;
      // Light from upper left, by the slope of the depth over two pixels.
      const auto slope = [&](std::size_t a, std::size_t b) {
        const double d = (depth[a] - depth[b]) * scale / 2;
        return std::isfinite(d) ? std::clamp(d, -3.0, 3.0) : 0.0;
      };
      const double gx = slope(cell - 1, cell + 1), gy = slope(cell - kSide, cell + kSide);
      const double light = (1.0 + 0.5 * -gx + 0.6 * gy) / std::sqrt((1 + gx * gx + gy * gy) * 1.61);
      const double shade = std::clamp(0.35 + 0.65 * light, 0.2, 1.0);
      for (std::size_t c = 0; c < 3; ++c)
        image.pixels[cell * 3 + c] = static_cast<std::uint8_t>(kColours[kind[cell]][c] * shade);
    }
  return image;
}

}  // namespace telefab::fab
