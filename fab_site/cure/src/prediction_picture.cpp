// SPDX-License-Identifier: GPL-3.0-or-later
#include "prediction_picture.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <telefab/image/palette.hpp>

namespace telefab::fab {
namespace {

constexpr int kPane = 900;
constexpr double kMargin = 40;
constexpr double kFull_px = 0.5;

double dot(const std::array<double, 3>& a, double x, double y, double z) { return a[0] * x + a[1] * y + a[2] * z; }

/// What a pixel of the picture sees.
struct Seen {
  float depth = -std::numeric_limits<float>::infinity();
  float x = 0, y = 0, z = 0;  ///< normal
  bool is_support = false;
};

/// Normals are averaged over a few pixels that lie as deep: steps of layers and pixels are finer than a pixel here, and
/// their sides and tops in turn would be noise.
void shade(const std::vector<Seen>& seen, float same_depth, int reach, Image& image) {
  const std::array<double, 3> light{-0.35, -0.6, 0.72};
  for (int y = 0; y < kPane; ++y)
    for (int x = 0; x < kPane; ++x) {
      const std::size_t at = static_cast<std::size_t>(y) * kPane + static_cast<std::size_t>(x);
      if (!std::isfinite(seen[at].depth)) continue;
      double nx = 0, ny = 0, nz = 0;
      for (int py = std::max(0, y - reach); py <= std::min(kPane - 1, y + reach); ++py)
        for (int px = std::max(0, x - reach); px <= std::min(kPane - 1, x + reach); ++px) {
          const Seen& other = seen[static_cast<std::size_t>(py) * kPane + static_cast<std::size_t>(px)];
          if (!(std::abs(other.depth - seen[at].depth) < same_depth) || other.is_support != seen[at].is_support)
            continue;
          nx += static_cast<double>(other.x);
          ny += static_cast<double>(other.y);
          nz += static_cast<double>(other.z);
        }
      const double length = std::max(1e-9, std::sqrt(nx * nx + ny * ny + nz * nz));
      const double level = 0.28 + 0.72 * std::max(0.0, dot(light, nx, ny, nz) / length);
      const Colour colour = seen[at].is_support ? palette::kSupport : palette::kPart;
      const std::array<std::uint8_t, 3> ink{colour.red, colour.green, colour.blue};
      for (std::size_t c = 0; c < 3; ++c) image.pixels[3 * at + c] = static_cast<std::uint8_t>(ink[c] * level);
    }
}

/// A picture and how large a millimetre is in it.
struct Pane {
  Image image;
  double px_per_mm = 0;
};

Pane shaded(std::span<const SurfacePoint> part, std::span<const SurfacePoint> supports, double spacing_mm) {
  Image image{kPane, kPane, 3, std::vector<std::uint8_t>(std::size_t{kPane} * kPane * 3, 255)};
  if (part.empty() && supports.empty()) return {std::move(image), 0};
  const Viewpoint v = usual_viewpoint();
  double left = 1e300, right = -1e300, low = 1e300, high = -1e300;
  for (const auto points : {part, supports})
    for (const SurfacePoint& p : points) {
      const double x = dot(v.right, p.x_mm, p.y_mm, p.z_mm), y = dot(v.up, p.x_mm, p.y_mm, p.z_mm);
      left = std::min(left, x);
      right = std::max(right, x);
      low = std::min(low, y);
      high = std::max(high, y);
    }
  const double scale = (kPane - 2 * kMargin) / std::max({right - left, high - low, 1e-6});
  // Every point covers its patch of the surface, so that nothing shines through.
  const int radius = std::max(1, static_cast<int>(std::ceil(0.75 * spacing_mm * scale)));
  std::vector<Seen> seen(std::size_t{kPane} * kPane);
  const auto put = [&](const SurfacePoint& p, bool is_support) {
    if (dot(v.away, p.normal_x, p.normal_y, p.normal_z) > 0.3) return;
    const int x = static_cast<int>(kPane / 2.0 + (dot(v.right, p.x_mm, p.y_mm, p.z_mm) - (left + right) / 2) * scale);
    const int y = static_cast<int>(kPane / 2.0 - (dot(v.up, p.x_mm, p.y_mm, p.z_mm) - (low + high) / 2) * scale);
    const auto z = static_cast<float>(-dot(v.away, p.x_mm, p.y_mm, p.z_mm));
    for (int py = std::max(0, y - radius); py <= std::min(kPane - 1, y + radius); ++py)
      for (int px = std::max(0, x - radius); px <= std::min(kPane - 1, x + radius); ++px) {
        Seen& pixel = seen[static_cast<std::size_t>(py) * kPane + static_cast<std::size_t>(px)];
        // The middle of a splat wins over the rims of its neighbours.
        const float ranked = z - static_cast<float>((std::abs(px - x) + std::abs(py - y)) * 0.5 / scale);
        if (ranked > pixel.depth) pixel = {ranked, p.normal_x, p.normal_y, p.normal_z, is_support};
      }
  };
  // Of what is in both, the first counts.
  for (const SurfacePoint& p : supports) put(p, true);
  for (const SurfacePoint& p : part) put(p, false);
  shade(seen, static_cast<float>(4 * spacing_mm), std::clamp(2 * radius + 2, 3, 9), image);
  return {std::move(image), scale};
}

void draw_edges(Canvas& canvas, double x0, std::span<const EdgeSample> samples) {
  if (samples.empty()) return;
  double left = 1e300, right = -1e300, low = 1e300, high = -1e300;
  for (const EdgeSample& s : samples) {
    left = std::min(left, s.place.x_px);
    right = std::max(right, s.place.x_px);
    low = std::min(low, s.place.y_px);
    high = std::max(high, s.place.y_px);
  }
  const double scale = (kPane - 2 * kMargin - 60) / std::max({right - left, high - low, 1.0});
  for (const EdgeSample& s : samples)
    canvas.disc({x0 + kPane / 2.0 + (s.place.x_px - (left + right) / 2) * scale,
                 kPane / 2.0 - (s.place.y_px - (low + high) / 2) * scale},
                std::clamp(scale, 1.5, 4.0), palette::deviation_colour(s.error_px / kFull_px));
}

}  // namespace

Image draw_prediction(std::span<const SurfacePoint> points, std::span<const SurfacePoint> supports,
                      std::span<const EdgeSample> samples, LayerIndex layer, const CureModel& model,
                      PictureCaption caption) {
  Canvas canvas{2 * kPane, kPane, palette::kPaper};
  const Pane pane = shaded(points, supports, std::max(model.pixel_pitch_mm, model.layer_mm));
  canvas.paste(pane.image, {0, 0}, kPane, kPane);
  draw_edges(canvas, kPane, samples);
  double sum = 0;
  for (const EdgeSample& s : samples) sum += std::abs(s.error_px);
  canvas.text({20, 28}, "what the masks will cure", palette::kInk, 12);
  const double z_mm = (layer.count() + 0.5) * model.layer_mm;
  canvas.text(
      {kPane + 20.0, 28},
      samples.empty()
          ? fmt::format("layer {} of the print, z = {:.3f} mm: no contours", layer.count(), z_mm)
          : fmt::format("layer {} of the print, z = {:.3f} mm: edge error, mean {:.3f} px of {:.0f} µm", layer.count(),
                        z_mm, sum / static_cast<double>(samples.size()), 1000 * model.pixel_pitch_mm),
      palette::kInk, 12);
  caption.legend = {{palette::kPart, "part"}};
  if (!supports.empty()) caption.legend.push_back({palette::kSupport, "supports and base"});
  caption.px_per_mm = pane.px_per_mm;
  caption.axes = axes_of(usual_viewpoint());
  return framed(canvas.image(), caption,
                {fmt::format("cured too little, -{:g} px", kFull_px), fmt::format("+{:g} px, cured beyond", kFull_px)});
}

}  // namespace telefab::fab
