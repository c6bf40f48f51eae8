// SPDX-License-Identifier: GPL-3.0-or-later
#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>
#include <telefab/fab/cure/size_calibration.hpp>

namespace telefab::fab {
namespace {

constexpr int kBars = 4;
constexpr double kWidestBar_mm = 10;
constexpr double kMargin = 0.9;  ///< of platform and travel
constexpr double kLeastBar_px = 40;
constexpr std::uint32_t kLeastStep_layers = 10;
constexpr double kStepOfBar = 0.5;                                     ///< height of a step over the width of a bar
constexpr std::array<double, kBars> kHolesOfBar{0.2, 0.3, 0.45, 0.6};  ///< diameters over the width of a bar
constexpr int kHoleVertices = 192;

struct Sizes {
  double bar_mm = 0;
  std::uint32_t step_layers = 0;
  double layer_mm = 0;
  Point2 corner;  ///< front left

  [[nodiscard]] double length_mm(int bar) const { return (kBars - bar) * bar_mm; }
  [[nodiscard]] double height_mm(int bar) const { return (bar + 1) * step_layers * layer_mm; }
};

Result<Sizes> sizes_of(const MachineProfile& machine) {
  const auto& platform = machine.platform;
  Sizes s;
  s.layer_mm = machine.layers.thickness_mm;
  s.bar_mm = std::min(kWidestBar_mm, kMargin * std::min(platform.width_mm, platform.depth_mm) / kBars);
  const double step_mm = std::min(kStepOfBar * s.bar_mm, kMargin * platform.z_travel_mm / kBars);
  s.step_layers = static_cast<std::uint32_t>(std::floor(step_mm / s.layer_mm + 1e-9));
  s.bar_mm = std::floor(s.bar_mm * 1000) / 1000;
  s.corner = {(platform.width_mm - kBars * s.bar_mm) / 2, (platform.depth_mm - kBars * s.bar_mm) / 2};
  if (s.bar_mm < kLeastBar_px * machine.projection.pixel_pitch_mm || s.step_layers < kLeastStep_layers)
    return fail(ErrorCode::InvalidInput,
                fmt::format("machine {}: on its platform and travel a bar of the body would be {:.3g} mm wide and a "
                            "step {} layers high; at least {:g} pixels and {} layers tell something",
                            machine.name, s.bar_mm, s.step_layers, kLeastBar_px, kLeastStep_layers));
  return s;
}

/// The bars from `first` on, as one outline.
std::vector<Point2> outline(const Sizes& s, int first) {
  const auto at = [&](double x, double y) { return Point2{s.corner.x_mm + x, s.corner.y_mm + y}; };
  std::vector<Point2> ring{at(0, first * s.bar_mm)};
  for (int bar = first; bar < kBars; ++bar) {
    ring.push_back(at(s.length_mm(bar), bar * s.bar_mm));
    ring.push_back(at(s.length_mm(bar), (bar + 1) * s.bar_mm));
  }
  ring.push_back(at(0, kBars * s.bar_mm));
  return ring;
}

std::vector<Point2> hole(const Sizes& s, int number) {
  const double radius = kHolesOfBar[static_cast<std::size_t>(number)] * s.bar_mm / 2;
  const Point2 middle{s.corner.x_mm + (number + 0.5) * s.bar_mm, s.corner.y_mm + s.bar_mm / 2};
  std::vector<Point2> ring;
  for (int i = 0; i < kHoleVertices; ++i) {
    const double turn = -2 * std::numbers::pi * i / kHoleVertices;
    ring.push_back({middle.x_mm + radius * std::cos(turn), middle.y_mm + radius * std::sin(turn)});
  }
  return ring;
}

Result<LayerStack> stack_of(const Sizes& s, const MachineProfile& machine) {
  StackHeader header;
  header.machine = machine.name;
  header.layer_thickness_mm = s.layer_mm;
  header.pixel_pitch_mm = machine.projection.pixel_pitch_mm;
  header.layer_count = kBars * s.step_layers;
  header.scan_name = "size";
  header.bounds = {s.corner, {s.corner.x_mm + kBars * s.bar_mm, s.corner.y_mm + kBars * s.bar_mm}};
  std::vector<Layer> layers;
  for (std::uint32_t i = 0; i < header.layer_count; ++i) {
    Layer layer;
    layer.index = LayerIndex{i};
    layer.z_mm = cut_height_mm(layer.index, s.layer_mm);
    const int first = static_cast<int>(i / s.step_layers);
    std::vector<std::vector<Point2>> rings{outline(s, first)};
    if (first == 0)
      for (int number = 0; number < kBars; ++number) rings.push_back(hole(s, number));
    for (auto& ring : rings) {
      auto contour = Contour::from_vertices(std::move(ring));
      if (!contour) return tl::unexpected{contour.error()};
      header.bounds.include(contour->bounds());
      layer.contours.push_back(std::move(*contour));
    }
    layer.contours = sorted_canonically(std::move(layer.contours));
    layers.push_back(std::move(layer));
  }
  return LayerStack::from_layers(std::move(header), std::move(layers));
}

}  // namespace

Result<SizeArtefact> size_artefact(const MachineProfile& machine) {
  const auto sizes = sizes_of(machine);
  if (!sizes) return tl::unexpected{sizes.error()};
  auto stack = stack_of(*sizes, machine);
  if (!stack) return tl::unexpected{stack.error()};
  std::string csv = "test,drawn_mm,value,unit\n";
  for (int bar = 0; bar < kBars; ++bar) csv += fmt::format("length-x,{:.6g},,mm\n", sizes->length_mm(bar));
  for (int bar = 0; bar < kBars; ++bar) csv += fmt::format("length-y,{:.6g},,mm\n", (bar + 1) * sizes->bar_mm);
  for (int bar = 0; bar < kBars; ++bar) csv += fmt::format("height,{:.6g},,mm\n", sizes->height_mm(bar));
  for (const double diameter : kHolesOfBar)
    csv += fmt::format("hole,{:.6g},,mm\n", diameter * sizes->bar_mm + 2 * machine.resin.hole_growth_mm);
  std::string readme = fmt::format(
      "# Sizes of {0} with {1}\n\n"
      "Print the body as any part, without supports:\n\n"
      "    telefab-fab plan size.tfc --machine {0} --supports none --out plan\n\n"
      "Wash and cure it as every part, let it rest for a day, and measure. Seen from above, the front below; numbers "
      "are "
      "heights:\n\n"
      "    +----------+\n"
      "    |  {5:8.3f}|\n"
      "    +----------+----------+\n"
      "    |             {4:8.3f}|\n"
      "    +---------------------+----------+\n"
      "    |                        {3:8.3f}|\n"
      "    +--------------------------------+----------+\n"
      "    | o        O         O         O    {2:8.3f}|\n"
      "    +-------------------------------------------+\n\n"
      "| test | measure |\n|---|---|\n"
      "| length-x | each bar from left to right, the front one first |\n"
      "| length-y | from the front to the back: at the right end, where only the front bar is, then one bar further "
      "left "
      "each time |\n"
      "| height | from the platform's side to the top of each bar, the front one first |\n"
      "| hole | diameters, from left to right, by pin gauges or a microscope |\n\n"
      "Write what you measure into measured.csv, as many rows a length as you like (three readings of each tell more "
      "than "
      "one); delete rows you did not measure. Keep away from the first millimetre above the platform: bottom layers "
      "are "
      "wider. Then run\n\n"
      "    telefab-fab calibrate size measured.csv --out sizes.toml\n\n"
      "and put what it says into the section [resin] of the profile.\n",
      machine.name, machine.resin.name, sizes->height_mm(0), sizes->height_mm(1), sizes->height_mm(2),
      sizes->height_mm(3));
  return SizeArtefact{std::move(*stack), std::move(csv), std::move(readme)};
}

}  // namespace telefab::fab
