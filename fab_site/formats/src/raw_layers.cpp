// SPDX-License-Identifier: GPL-3.0-or-later
#include "raw_layers.hpp"

#include <fmt/format.h>

#include <cmath>
#include <telefab/geometry/limits.hpp>

namespace telefab::fab {

Result<RawLayer*> RawLayers::at(double top_mm) {
  if (!std::isfinite(top_mm) || std::abs(top_mm) > kMaxCoordinateMm)
    return fail(ErrorCode::InvalidInput,
                fmt::format("a layer lies at {} mm; the limit is {} mm", top_mm, kMaxCoordinateMm));
  const auto key = std::llround(top_mm * 1e4);
  if (const auto found = layers_.find(key); found != layers_.end()) return &found->second;
  if (layers_.size() >= kMaxLayers) return fail(ErrorCode::TooLarge, fmt::format("more than {} layers", kMaxLayers));
  RawLayer& layer = layers_[key];
  layer.top_mm = top_mm;
  return &layer;
}

Result<void> RawLayers::add(RawLayer& layer, RawRing ring) {
  const auto where = [&] { return fmt::format("layer at {:.4f} mm", layer.top_mm); };
  if (layer.rings.size() >= kMaxRingsPerLayer)
    return fail(ErrorCode::TooLarge, fmt::format("{}: more than {} rings", where(), kMaxRingsPerLayer));
  layer.vertices += ring.vertices.size();
  if (layer.vertices > kMaxVerticesPerLayer)
    return fail(ErrorCode::TooLarge, fmt::format("{}: more than {} vertices", where(), kMaxVerticesPerLayer));
  for (const Point2 p : ring.vertices)
    if (!(std::abs(p.x_mm) <= kMaxCoordinateMm) || !(std::abs(p.y_mm) <= kMaxCoordinateMm))
      return fail(ErrorCode::InvalidInput, fmt::format("{}: a vertex at ({}, {}) mm; the limit is {} mm", where(),
                                                       p.x_mm, p.y_mm, kMaxCoordinateMm));
  layer.rings.push_back(std::move(ring));
  return {};
}

}  // namespace telefab::fab
