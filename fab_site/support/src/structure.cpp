// SPDX-License-Identifier: GPL-3.0-or-later
#include <algorithm>
#include <cmath>
#include <numbers>
#include <telefab/fab/support/structure.hpp>

namespace telefab::fab {
namespace {

/// Everything within the radius of a segment: half a disc at either end, joined. Chords lie inside the arcs.
Region stadium(Point2 a, Point2 b, double radius, Millimetres tolerance) {
  const double dx = b.x_mm - a.x_mm, dy = b.y_mm - a.y_mm;
  if (std::hypot(dx, dy) < 1e-6 || radius <= 0) return disc(a, Millimetres{radius}, tolerance);
  const double along = std::atan2(dy, dx);
  const double step = 2 * std::acos(std::clamp(1 - tolerance.count() / radius, 0.5, 1.0 - 1e-6));
  const int n = std::max(4, static_cast<int>(std::ceil(std::numbers::pi / step)));
  std::vector<GridRing> ring(1);
  for (int end = 0; end < 2; ++end)
    for (int i = 0; i <= n; ++i) {
      const double turn = along + std::numbers::pi * (end - 0.5 + static_cast<double>(i) / n);
      const Point2& c = end == 0 ? b : a;
      ring[0].push_back(to_grid({c.x_mm + radius * std::cos(turn), c.y_mm + radius * std::sin(turn)}));
    }
  return Region::from_rings(ring).value_or(Region{});
}

}  // namespace

std::string_view name_of(SupportElementKind kind) {
  switch (kind) {
    case SupportElementKind::Tip:
      return "tip";
    case SupportElementKind::Arm:
      return "arm";
    case SupportElementKind::Pin:
      return "pin";
    case SupportElementKind::Foot:
      return "foot";
    case SupportElementKind::Brace:
      return "brace";
    case SupportElementKind::ThinPin:
      return "thin-pin";
  }
  return "pin";
}

StructureSections::StructureSections(Structure structure, double thickness_mm, std::uint32_t layers,
                                     Millimetres arc_tolerance)
    : structure_{std::move(structure)}, thickness_mm_{thickness_mm}, arc_tolerance_{arc_tolerance} {
  elements_at_.resize(layers);
  for (std::uint32_t i = 0; i < structure_.elements.size(); ++i) {
    const SupportElement& element = structure_.elements[i];
    // Half-open and by the same comparison at both ends: where one element ends and the next begins no layer is lost.
    const double start = std::max(0.0, std::floor(element.bottom.z_mm / thickness_mm) - 1);
    for (auto k = static_cast<std::uint32_t>(start); k < layers && (k + 0.5) * thickness_mm < element.top.z_mm; ++k)
      if ((k + 0.5) * thickness_mm >= element.bottom.z_mm) elements_at_[k].push_back(i);
  }
  double height = 0;
  for (const Plate& plate : structure_.plates) height = std::max(height, plate.height_mm);
  plate_layers_ = static_cast<std::uint32_t>(std::ceil(height / thickness_mm - 0.5));
}

Region StructureSections::section(LayerIndex print_layer) const {
  const std::uint32_t k = print_layer.count();
  if (k >= elements_at_.size()) return {};
  const double z = (k + 0.5) * thickness_mm_;
  std::vector<Region> found;
  for (const std::uint32_t i : elements_at_[k]) {
    const SupportElement& s = structure_.elements[i];
    const double t = (z - s.bottom.z_mm) / (s.top.z_mm - s.bottom.z_mm);
    const auto mix = [t](double a, double b) { return a + t * (b - a); };
    found.push_back(disc({mix(s.bottom.x_mm, s.top.x_mm), mix(s.bottom.y_mm, s.top.y_mm)},
                         Millimetres{mix(s.bottom_radius_mm, s.top_radius_mm)}, arc_tolerance_));
  }
  if (k < plate_layers_)
    for (const Plate& plate : structure_.plates) {
      if (z >= plate.height_mm) continue;
      const double bevel = std::max(0.0, z - plate.height_mm / 2);
      found.push_back(stadium(plate.a, plate.b, plate.radius_mm - bevel, arc_tolerance_));
    }
  return unite(found);
}

double volume_mm3(const Structure& structure) {
  double volume = 0;
  for (const SupportElement& s : structure.elements) {
    const double a = s.bottom_radius_mm, b = s.top_radius_mm;
    volume += std::numbers::pi / 3 * (a * a + a * b + b * b) * (s.top.z_mm - s.bottom.z_mm);
  }
  for (const Plate& p : structure.plates) {
    const double length = std::hypot(p.b.x_mm - p.a.x_mm, p.b.y_mm - p.a.y_mm);
    volume += (2 * p.radius_mm * length + std::numbers::pi * p.radius_mm * p.radius_mm) * p.height_mm;
  }
  return volume;
}

}  // namespace telefab::fab
