// SPDX-License-Identifier: GPL-3.0-or-later
#include <gtest/gtest.h>

#include <cmath>
#include <numbers>
#include <telefab/fab/mask/blend.hpp>
#include <telefab/fab/mask/column_caps.hpp>
#include <telefab/test/mask_shapes.hpp>

// Masks of whole prints, judged by the cure module: what all layers together cure, at the middle of each layer.
namespace telefab::fab {
namespace {

using Rings = std::vector<Contour>;
constexpr double kPitch = 0.05;

/// The judge's machine with an exposure that cures two layers deep.
MachineProfile machine_two_deep() {
  MachineProfile machine = test::judge_machine(0.5);
  machine.layers.exposure_s = std::exp(2 * machine.layers.thickness_mm / machine.resin.penetration_mm);
  return machine;
}

Contour round(double radius_px, double x_px = 48.3, double y_px = 47.9) {
  std::vector<Point2> vertices;
  for (int i = 0; i < 200; ++i) {
    const double angle = 2 * std::numbers::pi * i / 200;
    vertices.push_back({kPitch * (x_px + radius_px * std::cos(angle)), kPitch * (y_px + radius_px * std::sin(angle))});
  }
  return Contour::from_vertices(std::move(vertices)).value();
}

Contour turned_square(double half_px, double degrees) {
  std::vector<Point2> vertices;
  for (int i = 0; i < 4; ++i) {
    const double angle = (degrees + 45 + 90 * i) * std::numbers::pi / 180, r = half_px * std::numbers::sqrt2;
    vertices.push_back({kPitch * (48.3 + r * std::cos(angle)), kPitch * (47.9 + r * std::sin(angle))});
  }
  return Contour::from_vertices(std::move(vertices)).value();
}

enum class Make { Cover, Stack, StackWithCaps };

/// Masks bottom first.
std::vector<Mask> masks_of(const MachineProfile& machine, const std::vector<Rings>& layers, Make make) {
  const MaskFrame frame = mask_frame(machine);
  const MaskLight light = mask_light(machine).value();
  std::vector<Mask> masks(layers.size());
  if (make == Make::Cover) {
    for (std::size_t i = 0; i < layers.size(); ++i) masks[i] = rasterise(layers[i], frame);
    return masks;
  }
  const MaskBlender blender = MaskBlender::make(frame, light, {}).value();
  const CapTable table{light, 12};
  std::vector<SolidRows> solid;
  for (const Rings& rings : layers) solid.emplace_back(rings, Rings{}, frame);
  BlendStack stack{blender};
  for (std::size_t n = layers.size(); n-- > 0;) {
    BlendTask task{.part = layers[n]};
    std::vector<const SolidRows*> below, above;
    for (std::size_t k = 1; k <= static_cast<std::size_t>(table.reach()) && k <= n; ++k) below.push_back(&solid[n - k]);
    for (std::size_t k = 1; k <= 12 && n + k < layers.size(); ++k) above.push_back(&solid[n + k]);
    const LayerCaps caps{table, solid[n], below, above, n < static_cast<std::size_t>(table.reach())};
    if (make == Make::StackWithCaps) task.caps = [&](std::uint32_t y, auto row) { return caps.fill(y, row); };
    masks[n] = stack.descend(task, 20).mask;
  }
  return masks;
}

/// Edges of layers [from, until) at their middles, after the whole print.
EdgeFigures edges_of(const MachineProfile& machine, const std::vector<Rings>& layers, const std::vector<Mask>& masks,
                     std::size_t from, std::size_t until) {
  const CureModel model = cure_model(machine).value();
  DoseStream light{model};
  EdgeFigures all;
  const std::chrono::nanoseconds lit{std::llround(1e9 * machine.layers.exposure_s)};
  for (std::size_t n = layers.size(); n-- > from;) {
    const MaskExposure exposure{masks[n].view(), lit};
    const DoseField dose = light.descend({&exposure, 1}).value();
    if (n < until) all.add(measure_edges(dose, model.to_middle(), {.rings = layers[n]}, kPitch, {}).value());
  }
  return all;
}

std::vector<Rings> cone(double radius_px, double a_layer_px) {
  std::vector<Rings> layers;
  for (int i = 0; i < 40; ++i) layers.push_back({round(radius_px + a_layer_px * i)});
  return layers;
}

EdgeFigures stacked(const std::vector<Rings>& layers, Make make = Make::StackWithCaps) {
  const MachineProfile machine = machine_two_deep();
  return edges_of(machine, layers, masks_of(machine, layers, make), 6, layers.size() - 12);
}

TEST(StackedMasks, KeepUprightWallsWhereCoverGrowsThemByHalfAPixel) {
  const std::vector<Rings> pillar(40, Rings{round(20.3)}), block(40, Rings{turned_square(14, 22)});
  EXPECT_LE(stacked(pillar).edges.mean_px(), 0.01);
  EXPECT_LE(stacked(block).edges.mean_px(), 0.01);
  EXPECT_GE(stacked(pillar, Make::Cover).edges.mean_px(), 0.5);
}

TEST(StackedMasks, KeepWallsOfAPixelAndAHalf) {
  const Contour hole = turned_square(12.5, 22);
  const Contour bore = Contour::from_vertices({hole.vertices().rbegin(), hole.vertices().rend()}).value();
  const EdgeFigures figures = stacked(std::vector<Rings>(40, Rings{turned_square(14, 22), bore}));
  EXPECT_LE(figures.edges.mean_px(), 0.02);
  EXPECT_EQ(figures.lost, 0);
}

TEST(StackedMasks, KeepConesThatNarrowAndWiden) {
  EXPECT_LE(stacked(cone(30, -0.45)).edges.mean_px(), 0.08);
  EXPECT_LE(stacked(cone(12, 0.45)).edges.mean_px(), 0.08);
}

/// A pillar with a plate on top that reaches beyond it.
std::vector<Rings> mushroom() {
  std::vector<Rings> layers(20, Rings{round(10)});
  layers.resize(40, Rings{round(30)});
  return layers;
}

/// Where the cured plate ends below, in layers under its lowest one, over the void; and its most.
std::pair<double, double> underside_of_mushroom(Make make) {
  const MachineProfile machine = machine_two_deep();
  const auto layers = mushroom();
  const auto masks = masks_of(machine, layers, make);
  const CureModel model = cure_model(machine).value();
  DoseStream light{model};
  const std::chrono::nanoseconds lit{std::llround(1e9 * machine.layers.exposure_s)};
  double mean = 0, most = 0;
  for (std::size_t n = layers.size(); n-- > 20;) {
    const MaskExposure exposure{masks[n].view(), lit};
    const DoseField dose = light.descend({&exposure, 1}).value();
    if (n > 20) continue;
    constexpr int places = 200;
    for (int i = 0; i < places; ++i) {
      const double angle = 2 * std::numbers::pi * i / places, r = 14 + 13.0 * i / places;
      const double depth =
          model.penetration_mm * std::log(dose.sample({48.3 + r * std::cos(angle), 47.9 + r * std::sin(angle)}).dose);
      const double off = depth / model.layer_mm - 1;
      mean += std::abs(off) / places;
      most = std::max(most, std::abs(off));
    }
  }
  return {mean, most};
}

TEST(StackedMasks, EndAtTheUndersideOfAPlateWhereCoverRunsThreeLayersDeep) {
  const auto [mean, most] = underside_of_mushroom(Make::StackWithCaps);
  EXPECT_LE(mean, 0.1);
  EXPECT_LE(most, 0.2);
  EXPECT_GE(underside_of_mushroom(Make::Cover).first, 2);
}

TEST(StackedMasks, LayersSeenThroughOnlyMayBeDrawnRoughly) {
  // A block of the stack that starts from drawn layers ends in nearly the masks of the whole stack.
  const MachineProfile machine = machine_two_deep();
  const MaskBlender blender = MaskBlender::make(mask_frame(machine), mask_light(machine).value(), {}).value();
  const Rings rings{turned_square(14, 22)};
  BlendStack whole{blender}, started{blender};
  for (int i = 0; i < 30; ++i) (void)whole.descend({.part = rings}, 20);
  for (int i = 0; i < 10; ++i) (void)started.descend({.part = rings}, i < 6 ? 0 : 20);
  const Mask a = whole.descend({.part = rings}, 20).mask, b = started.descend({.part = rings}, 20).mask;
  const auto lit = [&](const Mask& m) {
    double sum = 0;
    for (const auto grey : m.rows) sum += grey;
    return sum;
  };
  EXPECT_NEAR(lit(a) / lit(b), 1, 0.01);
}

TEST(CapTable, DarkensFromBelowUntilTheRestReachesTheUnderside) {
  MaskLight light;
  light.white = std::exp(1.0);  // two layers deep
  light.layer_mm = 0.05;
  light.penetration_mm = 0.1;
  const CapTable table{light, 20};
  for (const int layers : {1, 2, 5, 20}) {
    double dose = 0;  // at the underside
    for (int i = 0; i < layers; ++i)
      dose += light.white * std::exp(-(i + 1) * 0.5) * table.cap(i, layers - 1 - i) / 255;
    EXPECT_NEAR(dose, 1, 0.01) << layers;
  }
  EXPECT_EQ(table.cap(table.reach(), 3), 255);
}

}  // namespace
}  // namespace telefab::fab
