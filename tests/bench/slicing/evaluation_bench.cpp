// SPDX-License-Identifier: GPL-3.0-or-later
// One evaluation of the field beside a straightforward one (nanoflann, double, scalar exp), in one run.
#include <benchmark/benchmark.h>

#include <cmath>
#include <vector>

#include "clouds.hpp"
#include "machine_figures.hpp"
#include "reference_field.hpp"
#include "stages.hpp"
#include "stopwatch.hpp"

namespace telefab::bench {
namespace {

using benchmark::Counter;
using scan::Vec3;

/// Evaluations on the torus, one core: along sections from layer to layer as the marcher asks, and one place asked
/// again and again (nothing left to gather).
void evaluation(benchmark::State& state) {
  const bool walking = state.range(0) == 1;
  const auto field = surface_of(make_cloud(CloudKind::Torus, 250'000));
  const auto reference = reference_field(make_cloud(CloudKind::Torus, 250'000), field->kernel().kernel_mm);
  const auto fast = field->cursor();
  const auto slow = reference->cursor();
  std::vector<Vec3> path;
  for (int layer = 0; layer < (walking ? 8 : 1); ++layer)
    for (int i = 0; i < 400; ++i) {
      const double v = walking ? 6.283185307 * i / 400 : 1;
      const double z = 50 + 0.15 * layer;
      // The upright ring's tube near the axis' height.
      path.push_back(Vec3{70 + 35 + 15 * std::cos(v), 50 + 15 * std::sin(v), z});
    }
  double fast_s = 0, slow_s = 0;
  for (auto _ : state) {
    Stopwatch watch;
    for (const Vec3& p : path) benchmark::DoNotOptimize(fast->at(p));
    fast_s += watch.lap();
    for (const Vec3& p : path) benchmark::DoNotOptimize(slow->at(p));
    slow_s += watch.lap();
  }
  const double evaluations = static_cast<double>(path.size()) * static_cast<double>(state.iterations());
  const double neighbours = 3.14159265 * 10 * std::pow(field->kernel().kernel_mm / field->kernel().spacing_mm, 2);
  /// Multiplications and additions of both passes, a neighbour within the cut.
  constexpr double kFlop = 75;
  state.counters["neighbours"] = neighbours;
  state.counters["ns_per_evaluation"] = fast_s / evaluations * 1e9;
  state.counters["ns_per_neighbour"] = fast_s / evaluations / neighbours * 1e9;
  state.counters["reference_ns_per_evaluation"] = slow_s / evaluations * 1e9;
  state.counters["times_faster"] = slow_s / fast_s;
  if (const auto peak = fma_peak_gflops()) {
    state.counters["fma_peak_gflops"] = *peak;
    state.counters["share_of_fma_peak"] = evaluations * neighbours * kFlop / fast_s * 1e-9 / *peak;
  }
}
BENCHMARK(evaluation)->ArgName("walking")->Arg(1)->Arg(0)->Unit(benchmark::kMicrosecond);

}  // namespace
}  // namespace telefab::bench
