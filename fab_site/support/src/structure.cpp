// SPDX-License-Identifier: GPL-3.0-or-later
#include <algorithm>
#include <cmath>
#include <numbers>
#include <telefab/fab/support/structure.hpp>

namespace telefab::fab {
namespace {

/// A plate's section as a region; chords lie inside the arcs.
Region plate_region(const Plate& plate, double radius, Millimetres tolerance) {
  if (radius <= 0) return {};
  const double step = 2 * std::acos(std::clamp(1 - tolerance.count() / radius, 0.5, 1.0 - 1e-6));
  const auto corners = static_cast<double>(plate.corners.size());
  const int chords = std::max(4, static_cast<int>(std::ceil(2 * std::numbers::pi / step / std::min(corners, 2.0))));
  std::vector<GridRing> ring(1);
  for (const Point2 p : ring_around(plate.corners, radius, chords)) ring[0].push_back(to_grid(p));
  return Region::from_rings(ring).value_or(Region{});
}

}  // namespace

double Plate::radius_at(double z_mm) const {
  return radius_mm - std::max(0.0, z_mm - height_mm / 2) - lip * std::max(0.0, height_mm / 2 - z_mm);
}

std::vector<Point2> ring_around(std::span<const Point2> corners, double radius_mm, int chords) {
  std::vector<Point2> ring;
  const std::size_t n = corners.size();
  // Outwards from the edge that begins at a corner.
  const auto outwards = [&](std::size_t i) {
    const Point2 a = corners[i], b = corners[(i + 1) % n];
    return std::atan2(-(b.x_mm - a.x_mm), b.y_mm - a.y_mm);
  };
  for (std::size_t i = 0; i < n; ++i) {
    const double from = n == 1 ? 0 : outwards((i + n - 1) % n);
    double turn = n == 1 ? 2 * std::numbers::pi : std::remainder(outwards(i) - from, 2 * std::numbers::pi);
    if (n == 2 || turn < 0) turn = n == 2 ? std::numbers::pi : 0;
    const int last = n == 1 ? chords - 1 : chords;
    for (int c = 0; c <= last; ++c) {
      const double angle = from + turn * c / chords;
      ring.push_back({corners[i].x_mm + radius_mm * std::cos(angle), corners[i].y_mm + radius_mm * std::sin(angle)});
    }
  }
  return ring;
}

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
      found.push_back(plate_region(plate, plate.radius_at(z), arc_tolerance_));
    }
  return unite(found);
}

bool StructureSections::has_same_section(const StructureSections& other, LayerIndex print_layer) const {
  const std::uint32_t k = print_layer.count();
  if (k < std::max(plate_layers_, other.plate_layers_) && structure_.plates != other.structure_.plates) return false;
  const auto elements_of = [k](const StructureSections& sections) {
    return k < sections.elements_at_.size() ? std::span<const std::uint32_t>{sections.elements_at_[k]}
                                            : std::span<const std::uint32_t>{};
  };
  return std::ranges::equal(elements_of(*this), elements_of(other), [&](std::uint32_t a, std::uint32_t b) {
    return structure_.elements[a] == other.structure_.elements[b];
  });
}

double area_mm2(const Plate& plate) {
  double round = 0, twice = 0;
  for (std::size_t i = 0; i < plate.corners.size(); ++i) {
    const Point2 a = plate.corners[i], b = plate.corners[(i + 1) % plate.corners.size()];
    round += std::hypot(b.x_mm - a.x_mm, b.y_mm - a.y_mm);
    twice += a.x_mm * b.y_mm - b.x_mm * a.y_mm;
  }
  return twice / 2 + plate.radius_mm * round + std::numbers::pi * plate.radius_mm * plate.radius_mm;
}

double volume_mm3(const Structure& structure) {
  double volume = 0;
  for (const SupportElement& s : structure.elements) {
    const double a = s.bottom_radius_mm, b = s.top_radius_mm;
    volume += std::numbers::pi / 3 * (a * a + a * b + b * b) * (s.top.z_mm - s.bottom.z_mm);
  }
  for (const Plate& p : structure.plates) volume += area_mm2(p) * p.height_mm;
  return volume;
}

}  // namespace telefab::fab
