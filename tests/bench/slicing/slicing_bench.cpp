// What slicing costs, stage by stage, on a bumpy ball of 100 mm: layers a second, evaluations a vertex, nanoseconds a
// neighbour, one thread and two, and the ratio to a straightforward evaluation (nanoflann, double, scalar exp).
#include <benchmark/benchmark.h>
#include <tbb/enumerable_thread_specific.h>
#include <tbb/global_control.h>
#include <tbb/parallel_for.h>

#include <cmath>
#include <map>
#include <telefab/scan/topology/height_topology.hpp>
#include <telefab/test/analytic_field.hpp>

#include "layer_cutter.hpp"
#include "reference_field.hpp"

namespace telefab::bench {
namespace {

using namespace scan;

constexpr double kChordMm = 0.014;

/// The bumpy ball of the tests, sampled along evenly turned rays, about 100 mm across.
const PointCloud& bumpy_cloud(std::size_t points) {
  static std::map<std::size_t, PointCloud> clouds;
  PointCloud& cloud = clouds[points];
  if (!cloud.points.empty()) return cloud;
  const auto shape = test::bumpy(47, 1);
  const auto cursor = shape->cursor();
  for (std::size_t i = 0; i < points; ++i) {
    const double u = 2 * (static_cast<double>(i) + 0.5) / static_cast<double>(points) - 1;
    const double a = 2.399963229728653 * static_cast<double>(i);
    const Vec3 ray{std::sqrt(1 - u * u) * std::cos(a), std::sqrt(1 - u * u) * std::sin(a), u};
    Vec3 p = 47 * ray;
    FieldSample f = cursor->at(p);
    for (int k = 0; k < 6; ++k) {
      p -= f.value_mm / f.gradient.dot(ray) * ray;
      f = cursor->at(p);
    }
    cloud.points.push_back(p.cast<float>());
    cloud.normals.push_back(f.gradient.normalized().cast<float>());
  }
  return cloud;
}

std::unique_ptr<MlsField> field_of(std::size_t points, SurfaceKind surface = SurfaceKind::Unbiased) {
  return std::move(*MlsField::from_cloud(bumpy_cloud(points), {.surface = surface}, {}));
}

HeightTopology topology_of(const MlsField& field) {
  SurfaceSamples all, level;
  const Box3 box = field.bounds();
  field.samples_between(box.min.z(), box.max.z(), all);
  for (std::size_t i = 0; i < all.points.size(); ++i)
    if (std::abs(all.normals[i].z()) >= 0.866) {
      level.points.push_back(all.points[i]);
      level.normals.push_back(all.normals[i]);
    }
  return *analyse_height(field, level.points, level.normals, {}, {});
}

void surface(benchmark::State& state) {
  const auto points = static_cast<std::size_t>(state.range(0));
  (void)bumpy_cloud(points);
  for (auto _ : state) benchmark::DoNotOptimize(field_of(points));
  state.counters["ns_per_point"] = benchmark::Counter(
      static_cast<double>(points) * 1e-9, benchmark::Counter::kIsIterationInvariantRate | benchmark::Counter::kInvert);
}
BENCHMARK(surface)->Arg(250'000)->Arg(1'000'000)->Unit(benchmark::kMillisecond)->UseRealTime();

void topology(benchmark::State& state) {
  const auto field = field_of(static_cast<std::size_t>(state.range(0)));
  for (auto _ : state) benchmark::DoNotOptimize(topology_of(*field));
}
BENCHMARK(topology)->Arg(250'000)->Unit(benchmark::kMillisecond)->UseRealTime();

struct Cut {
  std::uint64_t vertices = 0;
  std::uint64_t evaluations = 0;
};

Cut cut_layers(const CutSetting& setting, double low_mm, double high_mm, std::uint32_t layers) {
  std::vector<Cut> cuts(layers);
  tbb::enumerable_thread_specific<std::unique_ptr<LayerCutter>> cutters;
  tbb::parallel_for(tbb::blocked_range<std::uint32_t>{0, layers, 8}, [&](const auto& range) {
    auto& cutter = cutters.local();
    if (!cutter) cutter = std::make_unique<LayerCutter>(setting);
    for (std::uint32_t i = range.begin(); i < range.end(); ++i) {
      const auto cut = cutter->cut(LayerIndex{i}, low_mm + (i + 0.5) / layers * (high_mm - low_mm), {});
      for (const Contour& c : cut->layer.contours) cuts[i].vertices += c.vertices().size();
      cuts[i].evaluations = cut->evaluations;
    }
  });
  Cut sum;
  for (const Cut& c : cuts) {
    sum.vertices += c.vertices;
    sum.evaluations += c.evaluations;
  }
  return sum;
}

/// Arguments: points, layers, threads.
void contours(benchmark::State& state) {
  const auto field = field_of(static_cast<std::size_t>(state.range(0)));
  const HeightTopology graph = topology_of(*field);
  const auto layers = static_cast<std::uint32_t>(state.range(1));
  const tbb::global_control threads{tbb::global_control::max_allowed_parallelism,
                                    static_cast<std::size_t>(state.range(2))};
  const CutSetting setting{
      .field = *field,
      .topology = &graph,
      .samples = [&](double low, double high, SurfaceSamples& found) { field->samples_between(low, high, found); },
      .band_mm = 0.4 * field->kernel().kernel_mm,
      .chord_mm = kChordMm,
      .known_fault = {}};
  const Box3 box = field->bounds();
  Cut cut;
  for (auto _ : state) cut = cut_layers(setting, box.min.z(), box.max.z(), layers);
  state.counters["layers_per_s"] = benchmark::Counter(layers, benchmark::Counter::kIsIterationInvariantRate);
  state.counters["vertices_per_layer"] = static_cast<double>(cut.vertices) / layers;
  state.counters["evaluations_per_vertex"] = static_cast<double>(cut.evaluations) / static_cast<double>(cut.vertices);
  state.counters["us_per_evaluation"] =
      benchmark::Counter(static_cast<double>(cut.evaluations) * 1e-6,
                         benchmark::Counter::kIsIterationInvariantRate | benchmark::Counter::kInvert);
}
BENCHMARK(contours)
    ->Args({250'000, 667, 1})
    ->Args({250'000, 667, 2})
    ->Args({250'000, 2000, 2})
    ->Args({1'000'000, 2000, 2})
    ->Unit(benchmark::kMillisecond)
    ->UseRealTime();

/// Evaluations along the sections of 250k points, one core: argument 0 is the reference.
void evaluation(benchmark::State& state) {
  const auto field = field_of(250'000);
  const bool fast = state.range(0) == 1;
  const auto reference = fast ? nullptr : reference_field(bumpy_cloud(250'000), field->kernel().kernel_mm);
  const auto cursor = fast ? field->cursor() : reference->cursor();
  std::vector<Vec3> path;
  for (int layer = 0; layer < 4; ++layer)
    for (int i = 0; i < 400; ++i) {
      const double a = 6.283185307 * i / 400;
      const auto shape = 43.0;
      path.emplace_back(shape * std::cos(a), shape * std::sin(a), 0.15 * layer);
    }
  // Onto the surface, as the marcher asks.
  for (Vec3& p : path)
    for (int k = 0; k < 40; ++k) {
      const FieldSample f = cursor->at(p);
      const Vec3 out = Vec3{p.x(), p.y(), 0}.normalized();
      p += f.in_reach ? Vec3{-f.value_mm / std::max(f.gradient.dot(out), 0.2) * out} : Vec3{0.2 * out};
    }
  for (auto _ : state)
    for (const Vec3& p : path) benchmark::DoNotOptimize(cursor->at(p));
  const double neighbours = 3.14159265 * 10 * std::pow(field->kernel().kernel_mm / field->kernel().spacing_mm, 2);
  state.counters["ns_per_evaluation"] =
      benchmark::Counter(static_cast<double>(path.size()) * 1e-9,
                         benchmark::Counter::kIsIterationInvariantRate | benchmark::Counter::kInvert);
  state.counters["ns_per_neighbour"] =
      benchmark::Counter(static_cast<double>(path.size()) * neighbours * 1e-9,
                         benchmark::Counter::kIsIterationInvariantRate | benchmark::Counter::kInvert);
}
BENCHMARK(evaluation)->ArgName("fast")->Arg(0)->Arg(1)->Unit(benchmark::kMicrosecond);

}  // namespace
}  // namespace telefab::bench

BENCHMARK_MAIN();
