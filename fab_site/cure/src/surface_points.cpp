// SPDX-License-Identifier: GPL-3.0-or-later
#include <fmt/format.h>

#include <bit>
#include <cmath>
#include <cstring>
#include <telefab/fab/cure/edge_points.hpp>
#include <telefab/fab/cure/surface_points.hpp>

#include "tile_sampler.hpp"

namespace telefab::fab {
namespace {

struct Normal {
  double x, y, z;
};

/// Of ln B - depth / Dp = 0, which grows inwards.
Normal normal_at(const DoseField::Sample& sample, const CureModel& model) {
  const double x = -sample.slope_x / (sample.dose * model.pixel_pitch_mm);
  const double y = -sample.slope_y / (sample.dose * model.pixel_pitch_mm);
  const double z = -1 / model.penetration_mm, length = std::sqrt(x * x + y * y + z * z);
  return {x / length, y / length, z / length};
}

SurfacePoint point_of(double x_mm, double y_mm, double z_mm, const Normal& n) {
  return {static_cast<float>(x_mm), static_cast<float>(y_mm), static_cast<float>(z_mm),
          static_cast<float>(n.x),  static_cast<float>(n.y),  static_cast<float>(n.z)};
}

bool kept(int pixel, int spacing) { return ((pixel % spacing) + spacing) % spacing == 0; }

void add_walls(const CuredLayer& layer, int spacing, std::vector<SurfacePoint>& points) {
  const CureModel& model = layer.model;
  const double pitch = model.pixel_pitch_mm, z_mm = (layer.index.count() + 0.5) * model.layer_mm;
  for (const EdgePoint& edge : edge_points(layer.dose, model.to_middle(), 2, 1)) {
    const double across = edge.on_upright ? edge.place.x_px : edge.place.y_px;
    if (!kept(static_cast<int>(std::floor(across)), spacing)) continue;
    const double steep = edge.steepness / pitch, down = 1 / model.penetration_mm, length = std::hypot(steep, down);
    const Normal n{edge.normal_x * steep / length, edge.normal_y * steep / length, -down / length};
    const double own = std::abs(edge.on_upright ? n.y : n.x), other = std::abs(edge.on_upright ? n.x : n.y);
    if (own < -n.z || own < other || (own == other && edge.on_upright)) continue;
    points.push_back(point_of(edge.place.x_px * pitch, edge.place.y_px * pitch, z_mm, n));
  }
}

/// Undersides, faces on top, and what stands on the platform.
void add_faces(const CuredLayer& layer, int spacing, std::vector<SurfacePoint>& points) {
  const CureModel& model = layer.model;
  const TileRange range = tiles_of(layer.dose.box());
  if (range.rows == 0) return;
  const double pitch = model.pixel_pitch_mm, top_mm = (layer.index.count() + 1.0) * model.layer_mm;
  const auto through = static_cast<float>(model.through());
  const TileSampler sampler{layer.dose.kernel(), 1, 0.5};
  std::vector<float> here(sampler.points() * sampler.points()), above(here.size());
  const bool covered = !layer.above.box().empty();
  for (int r = 0; r < range.rows; ++r) {
    const auto bounds = bounds_of_row(layer.dose, range, r);
    const auto bounds_above = bounds_of_row(layer.above, range, r);
    for (int c = 0; c < range.columns; ++c) {
      const TileBounds& b = bounds[static_cast<std::size_t>(c)];
      const bool whole = b.least > through, topped = bounds_above[static_cast<std::size_t>(c)].least > through;
      if (b.most < 1 || (whole && topped && layer.index.count() > 0)) continue;
      const int x0 = range.x + c * kTileSide, y0 = range.y + r * kTileSide;
      sampler.sample(layer.dose, x0, y0, here);
      if (covered)
        sampler.sample(layer.above, x0, y0, above);
      else
        std::fill(above.begin(), above.end(), 0.0F);
      for (int i = 0; i < kTileSide * kTileSide; ++i) {
        const int x = x0 + i % kTileSide, y = y0 + i / kTileSide;
        const float dose = here[static_cast<std::size_t>(i)];
        if (dose < 1 || !kept(x, spacing) || !kept(y, spacing)) continue;
        const double px = (x + 0.5) * pitch, py = (y + 0.5) * pitch;
        if (above[static_cast<std::size_t>(i)] < through) points.push_back(point_of(px, py, top_mm, {0, 0, 1}));
        if (dose >= through) {
          if (layer.index.count() == 0) points.push_back(point_of(px, py, 0, {0, 0, -1}));
          continue;
        }
        const Normal n = normal_at(layer.dose.sample({x + 0.5, y + 0.5}), model);
        if (-n.z < std::abs(n.x) || -n.z < std::abs(n.y)) continue;
        points.push_back(point_of(px, py, top_mm - model.penetration_mm * std::log(static_cast<double>(dose)), n));
      }
    }
  }
}

}  // namespace

std::vector<SurfacePoint> surface_points(const CuredLayer& layer, int spacing_px) {
  std::vector<SurfacePoint> points;
  const int spacing = std::clamp(spacing_px, 1, 64);
  add_walls(layer, spacing, points);
  add_faces(layer, spacing, points);
  return points;
}

std::vector<std::byte> to_ply(std::span<const SurfacePoint> points, std::string_view comment) {
  static_assert(sizeof(SurfacePoint) == 24 && std::endian::native == std::endian::little);
  const std::string head = fmt::format(
      "ply\nformat binary_little_endian 1.0\ncomment {}\nelement vertex {}\nproperty float x\nproperty float y\n"
      "property float z\nproperty float nx\nproperty float ny\nproperty float nz\nend_header\n",
      comment, points.size());
  std::vector<std::byte> bytes(head.size() + points.size() * sizeof(SurfacePoint));
  std::memcpy(bytes.data(), head.data(), head.size());
  if (!points.empty()) std::memcpy(bytes.data() + head.size(), points.data(), points.size() * sizeof(SurfacePoint));
  return bytes;
}

}  // namespace telefab::fab
