// SPDX-License-Identifier: GPL-3.0-or-later
#include "layer_source.hpp"

#include <cmath>

namespace telefab::fab {

Result<SourceLayer> LayerSource::layer(std::uint32_t print_layer) const {
  SourceLayer layer;
  const std::uint32_t elevation = supports_->elevation_layers();
  if (print_layer >= elevation) layer.part = stack_->layers()[print_layer - elevation].contours;
  const Region section = supports_->section_region(LayerIndex{print_layer});
  layer.section = section.to_contours();
  if (layer.part.empty()) {
    layer.supports = layer.section;
    return layer;
  }
  if (section.empty() && layer.part.size() == 1 && layer.part.front().signed_area_mm2() > 0) return layer;
  const auto part = Region::from_contours(layer.part);
  if (!part) return tl::unexpected{part.error()};
  if (!section.empty()) layer.supports = subtract(section, *part).to_contours();
  // Rings of open scans: a hole in nothing has an edge, but no light may be spent on it.
  double enclosed = 0, around = 0;
  for (const Contour& ring : layer.part) {
    enclosed += ring.signed_area_mm2();
    around += std::abs(ring.signed_area_mm2());
  }
  if (std::abs(enclosed - part->area_mm2()) > 1e-6 * around) {
    layer.bounded = part->to_contours();
    layer.part = layer.bounded;
  }
  return layer;
}

}  // namespace telefab::fab
