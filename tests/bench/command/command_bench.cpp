// SPDX-License-Identifier: GPL-3.0-or-later
// What a user waits for: the whole of `telefab-scan slice`, from file to .tfc, as a program of its own, on synthetic
// objects and on files given, clean and damaged; beside it in the same run Poisson reconstruction and section, and one
// evaluation of the field beside a straightforward one. Compare ratios within a run; seconds are for orientation.
#include <benchmark/benchmark.h>
#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <map>
#include <nlohmann/json.hpp>
#include <telefab/base/file.hpp>

#include "child.hpp"
#include "inputs.hpp"
#include "reconstruction.hpp"

namespace telefab::bench {
namespace {

namespace fs = std::filesystem;

struct Setup {
  std::vector<std::string> files;
  InputOptions inputs;
  std::vector<int> depths{8};
  double height_mm = 75;
  double layer_mm = 0.15;
  unsigned threads = 0;
};

/// CPU seconds of the last command on each input, for what is measured beside it.
using Costs = std::map<std::string, double>;

std::size_t layers_of(const Setup& setup) { return static_cast<std::size_t>(setup.height_mm / setup.layer_mm); }

void command(benchmark::State& state, const Input& input, const Setup& setup, const fs::path& folder, Costs& costs) {
  const fs::path report = folder / "report.json";
  const std::vector<std::string> arguments{"slice",       input.file.string(),
                                           "--machine",   "machine-a",
                                           "--out",       (folder / "layers.tfc").string(),
                                           "--height-mm", fmt::format("{}", setup.height_mm),
                                           "--layer-mm",  fmt::format("{}", setup.layer_mm),
                                           "--threads",   fmt::format("{}", setup.threads),
                                           "--force",     "--json"};
  Spent most;
  for (auto _ : state) {
    const auto spent = run_child(TELEFAB_SCAN, arguments, report);
    if (!spent) return state.SkipWithError(spent.error().what.c_str());
    state.SetIterationTime(spent->wall_s);
    if (most.cpu_s == 0 || spent->cpu_s < most.cpu_s) most.cpu_s = spent->cpu_s;
    most.peak_MB = std::max(most.peak_MB, spent->peak_MB);
  }
  costs[input.name] = most.cpu_s;
  const auto text = read_file(report, std::uint64_t{1} << 30U);
  if (!text) return state.SkipWithError(text.error().what.c_str());
  const auto stated = nlohmann::json::parse(text->begin(), text->end());
  const auto number = [&](const char* name) { return stated.at(name).get<double>(); };
  state.counters["cpu_s"] = most.cpu_s;
  state.counters["peak_MB"] = most.peak_MB;
  state.counters["bytes_a_point"] = most.peak_MB * 1e6 / static_cast<double>(input.points);
  state.counters["layers"] = number("layers_cut");
  state.counters["certified"] = number("certified") / number("layers_cut");
  state.counters["evaluations_a_vertex"] = number("evaluations") / number("vertices");
  state.counters["worst_layer_over_median"] =
      number("most_layer_evaluations") / std::max(1.0, number("median_layer_evaluations"));
  double all = 0;
  for (const auto& [stage, seconds] : stated.at("seconds").items()) all += seconds.get<double>();
  for (const auto& [stage, seconds] : stated.at("seconds").items())
    state.counters["share_" + stage] = seconds.get<double>() / all;
}

void poisson(benchmark::State& state, const Input& input, int depth, const Setup& setup, const fs::path& folder,
             const Costs& costs) {
  double cpu_s = 0, peak_MB = 0;
  for (auto _ : state) {
    const auto spent =
        run_child("/proc/self/exe",
                  {"reconstruct", input.file.string(), fmt::format("{}", depth), fmt::format("{}", layers_of(setup))},
                  folder / "reconstruct.txt");
    if (!spent) return state.SkipWithError(spent.error().what.c_str());
    state.SetIterationTime(spent->wall_s);
    if (cpu_s == 0 || spent->cpu_s < cpu_s) cpu_s = spent->cpu_s;
    peak_MB = std::max(peak_MB, spent->peak_MB);
  }
  state.counters["cpu_s"] = cpu_s;
  state.counters["peak_MB"] = peak_MB;
  if (const auto command = costs.find(input.name); command != costs.end())
    state.counters["times_the_command"] = cpu_s / command->second;
}

int reconstruct(char** words) {
  const auto made = reconstruct_and_cut(words[2], std::atoi(words[3]), static_cast<std::size_t>(std::atoll(words[4])));
  if (!made) fmt::print(stderr, "{}\n", made.error().what);
  return made ? 0 : 1;
}

int run(int argc, char** argv) {
  if (argc == 5 && std::string_view{argv[1]} == "reconstruct") return reconstruct(argv);
  benchmark::Initialize(&argc, argv);
  Setup setup;
  CLI::App app{
      "The whole of telefab-scan slice, beside what people use instead. Options of Google Benchmark come first."};
  app.add_option("FILE", setup.files, "scans; of those with faces points are drawn by area");
  app.add_option("--points", setup.inputs.points, "how many are drawn")->capture_default_str();
  app.add_option("--damages", setup.inputs.damages, "whole, bare, holes3, holes5, off10, noise2, two, all ...")
      ->delimiter(',')
      ->capture_default_str();
  app.add_option("--poisson", setup.depths, "depths of the octree tried beside; needs a build with PCL")
      ->delimiter(',');
  app.add_option("--height-mm", setup.height_mm, "of the part")->capture_default_str();
  app.add_option("--layer-mm", setup.layer_mm, "thickness of a layer")->capture_default_str();
  app.add_option("--threads", setup.threads, "of the command; 0: one a core")->capture_default_str();
  CLI11_PARSE(app, argc, argv);

  std::string folder_name = (fs::temp_directory_path() / "bench-command-XXXXXX").string();
  if (!::mkdtemp(folder_name.data())) {
    fmt::print(stderr, "no folder for the scans can be made in {}\n", fs::temp_directory_path().string());
    return 1;
  }
  const fs::path folder{folder_name};
  const auto inputs = make_inputs(setup.files, setup.inputs, folder);
  if (!inputs) {
    fmt::print(stderr, "{}\n", inputs.error().what);
    fs::remove_all(folder);
    return 1;
  }
  Costs costs;
  const auto once = [](benchmark::internal::Benchmark* made) {
    made->Iterations(1)->UseManualTime()->Unit(benchmark::kMillisecond);
  };
  for (const Input& input : *inputs) {
    once(benchmark::RegisterBenchmark(("command/" + input.name).c_str(),
                                      [&](benchmark::State& state) { command(state, input, setup, folder, costs); }));
    if (!input.has_normals) continue;
    for (const int depth : setup.depths)
      once(benchmark::RegisterBenchmark(
          fmt::format("poisson{}/{}", depth, input.name).c_str(),
          [&, depth](benchmark::State& state) { poisson(state, input, depth, setup, folder, costs); }));
  }
  benchmark::RunSpecifiedBenchmarks();
  fs::remove_all(folder);
  return 0;
}

}  // namespace
}  // namespace telefab::bench

int main(int argc, char** argv) { return telefab::bench::run(argc, argv); }
