// SPDX-License-Identifier: GPL-3.0-or-later
#include "prediction_picture.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <telefab/image/canvas.hpp>

namespace telefab::fab {
namespace {

constexpr int kPane = 900;
constexpr double kMargin = 30;
constexpr double kFull_px = 0.5;

/// A view: to the right, up, and towards the eye.
struct View {
  std::array<double, 3> right, up, towards;
};

View view() {
  constexpr double turn = 0.45, tilt = 0.40;
  const double c = std::cos(turn), s = std::sin(turn), ct = std::cos(tilt), st = std::sin(tilt);
  return {{c, s, 0}, {-s * st, c * st, ct}, {s * ct, -c * ct, st}};
}

double dot(const std::array<double, 3>& a, double x, double y, double z) { return a[0] * x + a[1] * y + a[2] * z; }

/// What a pixel of the picture sees.
struct Seen {
  float depth = -std::numeric_limits<float>::infinity();
  float x = 0, y = 0, z = 0;  ///< normal
};

/// Normals are averaged over a few pixels that lie as deep: steps of layers and pixels are finer than a pixel here, and
/// their sides and tops in turn would be noise.
void shade(const std::vector<Seen>& seen, float same_depth, Image& image) {
  constexpr int reach = 3;
  const std::array<double, 3> light{-0.35, -0.6, 0.72};
  for (int y = 0; y < kPane; ++y)
    for (int x = 0; x < kPane; ++x) {
      const std::size_t at = static_cast<std::size_t>(y) * kPane + static_cast<std::size_t>(x);
      if (!std::isfinite(seen[at].depth)) continue;
      double nx = 0, ny = 0, nz = 0;
      for (int py = std::max(0, y - reach); py <= std::min(kPane - 1, y + reach); ++py)
        for (int px = std::max(0, x - reach); px <= std::min(kPane - 1, x + reach); ++px) {
          const Seen& other = seen[static_cast<std::size_t>(py) * kPane + static_cast<std::size_t>(px)];
          if (!(std::abs(other.depth - seen[at].depth) < same_depth)) continue;
          nx += static_cast<double>(other.x);
          ny += static_cast<double>(other.y);
          nz += static_cast<double>(other.z);
        }
      const double length = std::max(1e-9, std::sqrt(nx * nx + ny * ny + nz * nz));
      const double level = 0.28 + 0.72 * std::max(0.0, dot(light, nx, ny, nz) / length);
      image.pixels[3 * at] = static_cast<std::uint8_t>(228 * level);
      image.pixels[3 * at + 1] = static_cast<std::uint8_t>(196 * level);
      image.pixels[3 * at + 2] = static_cast<std::uint8_t>(134 * level);
    }
}

Image shaded(std::span<const SurfacePoint> points, double spacing_mm) {
  Image image{kPane, kPane, 3, std::vector<std::uint8_t>(std::size_t{kPane} * kPane * 3, 255)};
  if (points.empty()) return image;
  const View v = view();
  double left = 1e300, right = -1e300, low = 1e300, high = -1e300;
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
  for (const SurfacePoint& p : points) {
    if (dot(v.towards, p.normal_x, p.normal_y, p.normal_z) < -0.3) continue;
    const int x = static_cast<int>(kPane / 2.0 + (dot(v.right, p.x_mm, p.y_mm, p.z_mm) - (left + right) / 2) * scale);
    const int y = static_cast<int>(kPane / 2.0 - (dot(v.up, p.x_mm, p.y_mm, p.z_mm) - (low + high) / 2) * scale);
    const auto z = static_cast<float>(dot(v.towards, p.x_mm, p.y_mm, p.z_mm));
    for (int py = std::max(0, y - radius); py <= std::min(kPane - 1, y + radius); ++py)
      for (int px = std::max(0, x - radius); px <= std::min(kPane - 1, x + radius); ++px) {
        Seen& pixel = seen[static_cast<std::size_t>(py) * kPane + static_cast<std::size_t>(px)];
        // The middle of a splat wins over the rims of its neighbours.
        const float ranked = z - static_cast<float>((std::abs(px - x) + std::abs(py - y)) * 0.5 / scale);
        if (ranked > pixel.depth) pixel = {ranked, p.normal_x, p.normal_y, p.normal_z};
      }
  }
  shade(seen, static_cast<float>(4 * spacing_mm), image);
  return image;
}

Colour colour_of(double error_px) {
  const double share = std::clamp(error_px / kFull_px, -1.0, 1.0), rest = 1 - std::abs(share);
  const auto level = [](double v) { return static_cast<std::uint8_t>(std::clamp(v, 0.0, 255.0)); };
  if (share > 0) return {level(150 + 105 * share), level(160 * rest), level(150 * rest)};
  return {level(150 * rest), level(160 * rest), level(150 - 105 * share)};
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
                std::clamp(scale, 1.5, 4.0), colour_of(s.error_px));
}

}  // namespace

Image draw_prediction(std::span<const SurfacePoint> points, std::span<const EdgeSample> samples, LayerIndex layer,
                      const CureModel& model) {
  Canvas canvas{2 * kPane, kPane, {255, 255, 255}};
  canvas.paste(shaded(points, std::max(model.pixel_pitch_mm, model.layer_mm)), {0, 0}, kPane, kPane);
  draw_edges(canvas, kPane, samples);
  double sum = 0;
  for (const EdgeSample& s : samples) sum += std::abs(s.error_px);
  canvas.text({12, 24}, "predicted part", {40, 40, 40}, 16);
  canvas.text({kPane + 12.0, 24},
              samples.empty() ? fmt::format("layer {}: no contours", layer.count())
                              : fmt::format("layer {}: edge error, mean {:.3f} px", layer.count(),
                                            sum / static_cast<double>(samples.size())),
              {40, 40, 40}, 16);
  for (int i = -10; i <= 10; ++i) {
    const double x = kPane + 260.0 + 18 * i;
    canvas.line({x, kPane - 24.0}, {x + 18, kPane - 24.0}, colour_of(i / 10.0 * kFull_px), 12);
  }
  canvas.text({kPane + 20.0, kPane - 18.0}, "-0.5", {40, 40, 40}, 14);
  canvas.text({kPane + 468.0, kPane - 18.0}, "+0.5 px, cured beyond", {40, 40, 40}, 14);
  return canvas.image();
}

}  // namespace telefab::fab
