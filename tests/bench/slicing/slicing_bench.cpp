// SPDX-License-Identifier: GPL-3.0-or-later
// What slicing costs without reading files, on seeded clouds 100 mm high: the stages of whole slices with their peak of
// memory, the contours alone on one thread and two, one evaluation beside a straightforward one (nanoflann, double,
// scalar exp), and the same layers cut with either. Ratios are taken within one run and stay true on a busy machine.
#include <benchmark/benchmark.h>
#include <tbb/task_arena.h>

#include <chrono>
#include <cmath>
#include <cstdio>
#include <ctime>
#include <string>
#include <telefab/scan/formats/read_cloud.hpp>

#include "clouds.hpp"
#include "machine_figures.hpp"
#include "reference_field.hpp"
#include "stages.hpp"
#include "stopwatch.hpp"

namespace telefab::bench {
namespace {

using namespace scan;
using benchmark::Counter;

CloudKind kind_of(std::int64_t argument) { return argument == 0 ? CloudKind::Torus : CloudKind::Bumpy; }
LayerRange all_layers(const MlsField& field, std::int64_t layers) {
  const Box3 box = field.bounds();
  return {box.min.z(), box.max.z(), static_cast<std::uint32_t>(layers)};
}

/// The targets: index, kernel, outliers, critical points, graph, contours.
void slice(benchmark::State& state) {
  const auto points = static_cast<std::size_t>(state.range(1));
  double surface_s = 0, topology_s = 0, contours_s = 0, bytes = 0;
  Cut cut;
  tbb::task_arena arena{static_cast<int>(state.range(3))};
  for (auto _ : state) {
    state.PauseTiming();
    const auto before = static_cast<double>(resident_memory());
    PointCloud cloud = make_cloud(kind_of(state.range(0)), points);
    reset_peak_memory();
    state.ResumeTiming();
    arena.execute([&] {
      Stopwatch watch;
      const auto field = surface_of(std::move(cloud));
      surface_s += watch.lap();
      const HeightTopology graph = topology_of(*field);
      topology_s += watch.lap();
      cut = cut_layers(setting_for(*field, *field, graph), all_layers(*field, state.range(2)));
      contours_s += watch.lap();
    });
    state.PauseTiming();
    bytes = std::max(bytes, static_cast<double>(peak_memory()) - before);
    state.ResumeTiming();
  }
  const auto each = [&](double sum) { return Counter(sum, Counter::kAvgIterations); };
  state.counters["surface_cpu_s"] = each(surface_s);
  state.counters["topology_cpu_s"] = each(topology_s);
  state.counters["contours_cpu_s"] = each(contours_s);
  state.counters["vertices_per_layer"] = static_cast<double>(cut.vertices) / static_cast<double>(cut.layers);
  state.counters["certified"] = static_cast<double>(cut.certified) / static_cast<double>(cut.layers);
  // The peak holds the cloud given (24 bytes a point).
  state.counters["peak_MB"] = bytes * 1e-6;
  state.counters["bytes_a_point_above_30MB"] = std::max(0.0, bytes - 30e6) / static_cast<double>(points);
}
BENCHMARK(slice)
    ->ArgNames({"bumpy", "points", "layers", "threads"})
    ->Args({0, 250'000, 667, 1})
    ->Args({0, 250'000, 667, 2})
    ->Args({1, 250'000, 667, 2})
    ->Args({0, 250'000, 2000, 2})
    ->Args({1, 250'000, 2000, 2})
    ->Args({0, 1'000'000, 2000, 2})
    ->Args({1, 1'000'000, 2000, 2})
    ->Args({0, 4'000'000, 2000, 2})
    ->Iterations(1)
    ->Unit(benchmark::kMillisecond)
    ->UseRealTime();

/// The contours alone; on two threads with the speed-up over one, taken alternately.
void contours(benchmark::State& state) {
  const auto field = surface_of(make_cloud(kind_of(state.range(0)), static_cast<std::size_t>(state.range(1))));
  const HeightTopology graph = topology_of(*field);
  const CutSetting setting = setting_for(*field, *field, graph);
  const LayerRange range = all_layers(*field, state.range(2));
  Cut cut;
  double cpu_s = 0, one_s = 0, two_s = 0;
  const auto timed = [&](int threads) {
    tbb::task_arena arena{threads};
    const auto start = std::chrono::steady_clock::now();
    arena.execute([&] { cut = cut_layers(setting, range); });
    return std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
  };
  for (auto _ : state) {
    Stopwatch watch;
    one_s += timed(1);
    cpu_s += watch.lap();
    two_s += timed(2);
  }
  const auto rounds = static_cast<double>(state.iterations());
  state.counters["layers_per_cpu_s"] = static_cast<double>(cut.layers) * rounds / cpu_s;
  state.counters["layers_per_s_2"] = static_cast<double>(cut.layers) * rounds / two_s;
  state.counters["speed_up_2"] = one_s / two_s;
  state.counters["vertices_per_layer"] = static_cast<double>(cut.vertices) / static_cast<double>(cut.layers);
  state.counters["evaluations_per_vertex"] = static_cast<double>(cut.evaluations) / static_cast<double>(cut.vertices);
  state.counters["cpu_ns_per_evaluation"] = cpu_s / rounds * 1e9 / static_cast<double>(cut.evaluations);
}
BENCHMARK(contours)
    ->ArgNames({"bumpy", "points", "layers"})
    ->Args({0, 250'000, 667})
    ->Args({1, 250'000, 667})
    ->Args({0, 250'000, 2000})
    ->Args({0, 1'000'000, 2000})
    ->Unit(benchmark::kMillisecond)
    ->UseRealTime();

/// Eight of 160 layers of the torus, cut with the field and with the reference, alternately, on one core.
void against_reference(benchmark::State& state) {
  const auto points = static_cast<std::size_t>(state.range(0));
  const auto field = surface_of(make_cloud(CloudKind::Torus, points));
  const auto reference = reference_field(make_cloud(CloudKind::Torus, points), field->kernel().kernel_mm);
  const HeightTopology graph = topology_of(*field);
  const CutSetting fast = setting_for(*field, *field, graph);
  const CutSetting slow = setting_for(*reference, *field, graph);
  double fast_s = 0, slow_s = 0;
  tbb::task_arena arena{1};
  // Blocks of eight neighbours, as slicing cuts them.
  const auto cut = [&](const CutSetting& setting) {
    Cut sum;
    for (std::uint32_t first = 11; first < 2000; first += 160) {
      const Cut part = arena.execute([&] {
        LayerRange block = all_layers(*field, 2000);
        block.first = first;
        block.end = first + 8;
        return cut_layers(setting, block);
      });
      sum.vertices += part.vertices;
      sum.layers += part.layers;
    }
    return sum;
  };
  Cut own, its;
  for (auto _ : state) {
    Stopwatch watch;
    own = cut(fast);
    fast_s += watch.lap();
    its = cut(slow);
    slow_s += watch.lap();
  }
  state.counters["times_faster"] = slow_s / fast_s;
  state.counters["reference_layers_per_s"] =
      static_cast<double>(its.layers) * static_cast<double>(state.iterations()) / slow_s;
  state.counters["vertices_over_its"] = static_cast<double>(own.vertices) / static_cast<double>(its.vertices);
}
BENCHMARK(against_reference)->ArgName("points")->Arg(250'000)->Arg(1'000'000)->Unit(benchmark::kMillisecond);

std::string binary_ply(const PointCloud& cloud) {
  std::string file = "ply\nformat binary_little_endian 1.0\nelement vertex " + std::to_string(cloud.size()) +
                     "\nproperty float x\nproperty float y\nproperty float z\nproperty float nx\nproperty float "
                     "ny\nproperty float nz\nend_header\n";
  for (std::size_t i = 0; i < cloud.size(); ++i) {
    file.append(reinterpret_cast<const char*>(cloud.points[i].data()), 12);
    file.append(reinterpret_cast<const char*>(cloud.normals[i].data()), 12);
  }
  return file;
}

std::string text_lines(const PointCloud& cloud) {
  std::string file;
  char line[160];
  for (std::size_t i = 0; i < cloud.size(); ++i) {
    const auto& p = cloud.points[i];
    const auto& n = cloud.normals[i];
    const int length =
        std::snprintf(line, sizeof line, "%.6f %.6f %.6f %.6f %.6f %.6f\n", p.x(), p.y(), p.z(), n.x(), n.y(), n.z());
    file.append(line, static_cast<std::size_t>(length));
  }
  return file;
}

/// Reading from memory: the raw file, and the cloud made ready (duplicates merged). Argument: text or binary PLY.
void reading(benchmark::State& state) {
  const PointCloud cloud = make_cloud(CloudKind::Torus, 1'000'000);
  const std::string file = state.range(0) == 1 ? text_lines(cloud) : binary_ply(cloud);
  const std::span<const std::byte> bytes = std::as_bytes(std::span{file});
  double raw_s = 0, ready_s = 0, copy_s = 0;
  std::string copy(file.size(), ' ');
  for (auto _ : state) {
    Stopwatch watch;
    std::copy(file.begin(), file.end(), copy.begin());
    benchmark::DoNotOptimize(copy.data());
    copy_s += watch.lap();
    benchmark::DoNotOptimize(read_scan_file(bytes, "scan.xyz", ReadOptions{}, {}));
    raw_s += watch.lap();
    benchmark::DoNotOptimize(read_cloud(bytes, "scan.xyz", ReadOptions{}, {}));
    ready_s += watch.lap();
  }
  const double megabytes = 1e-6 * static_cast<double>(file.size()) * static_cast<double>(state.iterations());
  state.counters["memcpy_MB_per_s"] = megabytes / copy_s;
  state.counters["read_MB_per_s"] = megabytes / raw_s;
  state.counters["ready_MB_per_s"] = megabytes / ready_s;
}
BENCHMARK(reading)->ArgName("text")->Arg(0)->Arg(1)->Unit(benchmark::kMillisecond);

}  // namespace
}  // namespace telefab::bench

BENCHMARK_MAIN();
