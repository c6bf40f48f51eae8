// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <cmath>
#include <functional>
#include <numbers>
#include <telefab/geometry/layer.hpp>
#include <telefab/machine/machine_profile.hpp>
#include <vector>

// Small layer stacks made by formula, for the tests of supports.
namespace telefab::fab::stacks {

inline std::vector<Point2> box(double x0, double y0, double x1, double y1) {
  return {{x0, y0}, {x1, y0}, {x1, y1}, {x0, y1}};
}

inline std::vector<Point2> circle(double x, double y, double r, int n = 64) {
  std::vector<Point2> v;
  for (int i = 0; i < n; ++i) {
    const double a = 2 * std::numbers::pi * i / n;
    v.push_back({x + r * std::cos(a), y + r * std::sin(a)});
  }
  return v;
}

inline MachineProfile machine() {
  MachineProfile m;
  m.name = "test";
  m.platform = {100, 100, 100};
  m.projection.pixel_pitch_mm = 0.14;
  m.projection.irradiance_mw_per_cm2 = 3.02;
  m.layers = {0.15, 9.0, 4, 36.0};
  m.resin.penetration_mm = 0.3;
  return m;
}

struct Stack {
  StackHeader header;
  std::vector<Layer> layers;
};

/// `rings(z)` gives the outer rings (counter-clockwise) and holes (clockwise) at height z.
inline Stack stack(double height_mm, const std::function<std::vector<std::vector<Point2>>(double)>& rings) {
  Stack s;
  const MachineProfile m = machine();
  const double t = m.layers.thickness_mm;
  const auto count = static_cast<std::uint32_t>(std::lround(height_mm / t));
  s.header.machine = m.name;
  s.header.layer_thickness_mm = t;
  s.header.pixel_pitch_mm = m.projection.pixel_pitch_mm;
  s.header.layer_count = count;
  s.header.bounds = {{0, 0}, {100, 100}};
  for (std::uint32_t k = 0; k < count; ++k) {
    Layer layer;
    layer.index = LayerIndex{k};
    layer.z_mm = cut_height_mm(layer.index, t);
    for (auto& ring : rings(layer.z_mm))
      if (auto c = Contour::from_vertices(std::move(ring))) layer.contours.push_back(*c);
    s.layers.push_back(std::move(layer));
  }
  return s;
}

/// A tunnel of half-round section through a block: it closes by itself.
inline Stack vault() {
  return stack(12, [](double z) {
    const double r = 3, half = z < r ? std::sqrt(r * r - z * z) : 0;
    std::vector<std::vector<Point2>> rings;
    if (half <= 0) return rings = {box(40, 40, 60, 60)};
    return rings = {box(40, 40, 50 - half, 60), box(50 + half, 40, 60, 60)};
  });
}

inline Stack mushroom() {
  return stack(15, [](double z) { return std::vector<std::vector<Point2>>{circle(50, 50, z < 9 ? 3 : 15)}; });
}

inline Stack table() {
  return stack(12, [](double z) {
    if (z > 10) return std::vector<std::vector<Point2>>{box(30, 30, 70, 70)};
    return std::vector<std::vector<Point2>>{box(30, 30, 34, 34), box(66, 30, 70, 34), box(66, 66, 70, 70),
                                            box(30, 66, 34, 70)};
  });
}

inline Stack ball() {
  return stack(20, [](double z) {
    const double r2 = 100 - (z - 10) * (z - 10);
    return std::vector<std::vector<Point2>>{circle(50, 50, std::sqrt(std::max(1e-6, r2)))};
  });
}

/// A column with an arm whose end hangs down: the drop begins in mid-air above the foot plate.
inline Stack hook() {
  return stack(20, [](double z) {
    std::vector<std::vector<Point2>> rings;
    if (z < 2) return rings = {box(30, 40, 70, 60)};
    rings = {box(30, 45, 36, 55)};
    if (z > 16) return rings = {box(30, 45, 66, 55)};
    if (z > 10) rings.push_back(box(60, 47, 66, 53));
    return rings;
  });
}

/// The same over ribs that are no higher than a foot's clearance.
inline Stack hook_over_ribs() {
  return stack(20, [](double z) {
    std::vector<std::vector<Point2>> rings;
    if (z < 2) return rings = {box(30, 40, 70, 60)};
    rings = {box(30, 45, 36, 55)};
    if (z > 16) return rings = {box(30, 45, 66, 55)};
    for (double x = 55; x < 69 && z < 3.3; x += 1.2) rings.push_back(box(x, 42, x + 0.6, 58));
    if (z > 10) rings.push_back(box(60, 47, 66, 53));
    return rings;
  });
}

inline std::vector<Point2> mast_with_arm() {
  return {{40, 45}, {50, 45}, {50, 49.5}, {53, 49.5}, {53, 50.5}, {50, 50.5}, {50, 55}, {40, 55}};
}

/// A tall mast with a short arm at its top: what holds the arm has no neighbour.
inline Stack flag() {
  return stack(90, [](double z) {
    if (z > 87) return std::vector<std::vector<Point2>>{mast_with_arm()};
    return std::vector<std::vector<Point2>>{box(40, 45, 50, 55)};
  });
}

/// The same in a narrow body that leaves no room beside the pin.
inline Stack flag_in_a_shaft() {
  return stack(90, [](double z) {
    if (z > 87) return std::vector<std::vector<Point2>>{mast_with_arm()};
    auto rings = std::vector<std::vector<Point2>>{box(40, 45, 50, 55)};
    rings.push_back(box(54.5, 45, 60, 55));
    rings.push_back(box(50.5, 52, 60, 62));
    rings.push_back(box(50.5, 38, 60, 48));
    return rings;
  });
}

inline Stack tilted_cylinder() {
  return stack(7.5, [](double z) { return std::vector<std::vector<Point2>>{circle(25 + 6 * z, 50, 4)}; });
}

}  // namespace telefab::fab::stacks
