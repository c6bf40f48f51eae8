// SPDX-License-Identifier: GPL-3.0-or-later
#include <benchmark/benchmark.h>

#include <cmath>
#include <telefab/fab/support/support_plan.hpp>
#include <telefab/fab/verify/support_check.hpp>

#include "irregular_regions.hpp"
#include "stacks.hpp"

namespace telefab::fab {
namespace {

/// A ragged blob of that area in units of the reach squared.
Region blob(double area) {
  std::vector<GridRing> ring(1);
  const double r = std::sqrt(area / std::numbers::pi / 1.11);
  for (int i = 0; i < 400; ++i) {
    const double a = 2 * std::numbers::pi * i / 400;
    const double rho = r * (1 + 0.3 * std::sin(3 * a) + 0.25 * std::cos(7 * a));
    ring[0].push_back(to_grid({200 + rho * std::cos(a), 200 + rho * std::sin(a)}));
  }
  return Region::from_rings(ring).value();
}

void cover_a_blob(benchmark::State& state) {
  const Region region = blob(static_cast<double>(state.range(0)));
  CoveringOptions options;
  options.anchor_distance = Millimetres{1};
  std::size_t anchors = 0;
  for (auto _ : state) anchors = cover_region(region, options, {})->anchors.size();
  state.counters["anchors"] = static_cast<double>(anchors);
  state.counters["bound"] = covering_lower_bound(region, options.anchor_distance);
}
BENCHMARK(cover_a_blob)
    ->Arg(3)
    ->Arg(10)
    ->Arg(30)
    ->Arg(100)
    ->Arg(140)
    ->Arg(300)
    ->Arg(1000)
    ->Arg(5000)
    ->Unit(benchmark::kMillisecond);

void cover_twelve_irregular_regions(benchmark::State& state) {
  const auto all = shapes::twelve();
  const auto& shape = all[static_cast<std::size_t>(state.range(0))];
  CoveringOptions options;
  options.anchor_distance = Millimetres{1};
  std::size_t anchors = 0;
  for (auto _ : state) anchors = cover_region(shape.region, options, {})->anchors.size();
  CoveringOptions plain = options;
  plain.plain = true;
  state.counters["anchors"] = static_cast<double>(anchors);
  state.counters["plain"] = static_cast<double>(cover_region(shape.region, plain, {})->anchors.size());
  state.counters["grid"] = static_cast<double>(grid_covering(shape.region, options.anchor_distance).size());
  state.counters["bound"] = covering_lower_bound(shape.region, options.anchor_distance);
  state.SetLabel(shape.name);
}
BENCHMARK(cover_twelve_irregular_regions)->DenseRange(0, 11)->Unit(benchmark::kMillisecond);

void analyse_a_pair_of_layers(benchmark::State& state) {
  const Region below = blob(3000), current = offset(below, Millimetres{0.4}, Millimetres{0.01});
  const SelfSupportLaw law = self_support_law(stacks::machine());
  for (auto _ : state) benchmark::DoNotOptimize(analyse_layer(below, current, law));
}
BENCHMARK(analyse_a_pair_of_layers)->Unit(benchmark::kMillisecond);

/// A plate high above the platform on one corner column: nothing but pins.
stacks::Stack shelf(double side, double height) {
  return stacks::stack(height, [=](double z) {
    if (z > height - 2) return std::vector<std::vector<Point2>>{stacks::box(2, 2, 2 + side, 2 + side)};
    return std::vector<std::vector<Point2>>{stacks::box(2, 2, 14, 14)};
  });
}

void plan_a_shelf(benchmark::State& state) {
  auto s = shelf(static_cast<double>(state.range(0)), static_cast<double>(state.range(1)));
  s.header.bounds = {{0, 0}, {200, 200}};
  MachineProfile machine = stacks::machine();
  machine.platform = {200, 200, 200};
  SupportFigures figures;
  std::size_t anchors = 0;
  for (auto _ : state) {
    const auto plan = plan_supports(s.layers, s.header, machine, {}, {}, {});
    anchors = plan->anchors().size();
    figures = plan->figures();
  }
  state.counters["anchors"] = static_cast<double>(anchors);
  state.counters["braces"] = figures.braces;
}
BENCHMARK(plan_a_shelf)
    ->Args({50, 20})
    ->Args({180, 20})
    ->Args({180, 75})
    ->Args({180, 180})
    ->Unit(benchmark::kMillisecond);

void cut_a_shelfs_supports(benchmark::State& state) {
  const auto s = shelf(180, 75);
  MachineProfile machine = stacks::machine();
  machine.platform = {200, 200, 200};
  const auto plan = plan_supports(s.layers, s.header, machine, {}, {}, {});
  std::uint32_t k = 0;
  for (auto _ : state) {
    benchmark::DoNotOptimize(plan->section_region(LayerIndex{k}));
    k = (k + 7) % static_cast<std::uint32_t>(s.layers.size());
  }
}
BENCHMARK(cut_a_shelfs_supports)->Unit(benchmark::kMillisecond);

void plan_a_ball(benchmark::State& state) {
  const auto s = stacks::ball();
  for (auto _ : state)
    benchmark::DoNotOptimize(plan_supports(s.layers, s.header, stacks::machine(), {}, {}, {})->anchors().size());
}
BENCHMARK(plan_a_ball)->Unit(benchmark::kMillisecond);

}  // namespace
}  // namespace telefab::fab
