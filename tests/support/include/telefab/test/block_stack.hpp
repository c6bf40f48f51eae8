// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <telefab/geometry/layer.hpp>
#include <telefab/machine/machine_profile.hpp>

namespace telefab::test {

/// A small machine, 40 x 30 mm with pixels and layers of 0.1 mm.
[[nodiscard]] inline MachineProfile small_machine() {
  MachineProfile m;
  m.name = "small";
  m.platform = {40, 30, 50};
  m.projection.pixel_pitch_mm = 0.1;
  m.projection.irradiance_mw_per_cm2 = 10;
  m.layers = {0.1, 2.0, 3, 8.0};
  m.resin = {"assumed", 5, 0.2};
  m.supports.self_support_mm = 0.1;
  return m;
}

[[nodiscard]] inline Contour rectangle(double x0, double y0, double x1, double y1) {
  return Contour::from_vertices({{x0, y0}, {x1, y0}, {x1, y1}, {x0, y1}}).value();
}

/// One layer a list of rings, for small_machine().
[[nodiscard]] inline LayerStack stack_of(const std::vector<std::vector<Contour>>& rings) {
  StackHeader header;
  header.machine = "small";
  header.scan_name = "blocks";
  header.layer_thickness_mm = 0.1;
  header.pixel_pitch_mm = 0.1;
  header.layer_count = static_cast<std::uint32_t>(rings.size());
  header.bounds = {{0, 0}, {40, 30}};
  std::vector<Layer> layers;
  for (std::uint32_t i = 0; i < header.layer_count; ++i) {
    Layer layer;
    layer.index = LayerIndex{i};
    layer.z_mm = cut_height_mm(layer.index, header.layer_thickness_mm);
    layer.contours = rings[i];
    layers.push_back(std::move(layer));
  }
  return LayerStack::from_layers(std::move(header), std::move(layers)).value();
}

/// A table: a block of `foot` layers, then a plate that hangs 8 mm over it on one side.
[[nodiscard]] inline LayerStack table(std::uint32_t foot, std::uint32_t plate) {
  std::vector<std::vector<Contour>> rings(foot, {rectangle(5, 5, 15, 15)});
  rings.resize(foot + plate, {rectangle(5, 5, 23, 15)});
  return stack_of(rings);
}

}  // namespace telefab::test
