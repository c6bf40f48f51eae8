// SPDX-License-Identifier: GPL-3.0-or-later
// Is the way that a scan is made to stand a good one? Scans by path: 40 directions spread evenly, each sliced and
// supported by the real planner, and the ways that are chosen from the estimate. Run by hand; a row an object, and with
// --all a row a direction.
#include <fmt/format.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <charconv>
#include <chrono>
#include <filesystem>
#include <telefab/base/clock.hpp>
#include <telefab/base/file.hpp>
#include <telefab/fab/support/support_plan.hpp>
#include <telefab/machine/profile_catalogue.hpp>
#include <telefab/scan/cloud/units.hpp>
#include <telefab/scan/placing/standing.hpp>
#include <telefab/scan/slicing/slice_scan.hpp>

namespace telefab {
namespace {

namespace fs = std::filesystem;
constexpr std::uint64_t kMaxBytes = 4ULL << 30U;

struct Setup {
  std::vector<fs::path> scans;
  std::string machine = "machine-a";
  double largest_mm = 40;
  double layer_mm = 0;  ///< 0: the machine's
  std::uint32_t spread = 40;
  std::size_t shortlist = 8;
  bool all = false;
  bool estimate_only = false;
};

double now_s() { return std::chrono::duration<double>(std::chrono::steady_clock::now().time_since_epoch()).count(); }

/// What the planner says of a way to stand.
struct Planned {
  double support_mm3 = 0, part_mm3 = 0;
  std::size_t anchors = 0;
  double share() const { return part_mm3 > 0 ? support_mm3 / part_mm3 : 0; }
};

Result<Planned> planned(std::span<const std::byte> scan, const std::string& name, const scan::SliceRequest& request,
                        const scan::Turn& turn) {
  scan::SliceRequest turned = request;
  turned.placement.turn = turn;
  std::vector<Layer> layers;
  StackHeader header;
  const auto sliced = scan::slice_scan(scan, name, turned,
                                       [&](const StackHeader& h, Layer&& layer) -> Result<void> {
                                         header = h;
                                         layers.push_back(std::move(layer));
                                         return {};
                                       },
                                       {}, {});
  if (!sliced) return tl::unexpected{sliced.error()};
  const auto plan = fab::plan_supports(layers, header, request.machine, {}, {}, {});
  if (!plan) return tl::unexpected{plan.error()};
  return Planned{plan->figures().support_mm3, plan->figures().part_mm3, plan->anchors().size()};
}

void print_row(const std::string& name, const scan::Standing& s, const Result<Planned>& plan) {
  const auto& f = s.figures;
  const Eigen::Vector3d up = s.turn.matrix().row(2);
  fmt::print(
      "  {} {:<14} up {:6.3f} {:6.3f} {:6.3f} estimate {:8.1f} mm3 {:4} anchors overhang {:7.1f} lifted {:d} "
      "layers {:4} trapped {:6.1f} stability {:5.2f} planner {}\n",
      name, name_of(s.source), up.x(), up.y(), up.z(), f.support_mm3, f.anchors, f.overhang_mm2, f.is_lifted, f.layers,
      f.trapped_mm3, f.stability,
      plan ? fmt::format("{:8.1f} mm3 {:4} anchors", plan->support_mm3, plan->anchors) : plan.error().what);
}

double rank_correlation(const std::vector<std::pair<double, double>>& pairs) {
  const auto ranks = [&](auto member) {
    std::vector<std::size_t> order(pairs.size());
    for (std::size_t i = 0; i < order.size(); ++i) order[i] = i;
    std::stable_sort(order.begin(), order.end(), [&](auto a, auto b) { return member(pairs[a]) < member(pairs[b]); });
    std::vector<double> rank(pairs.size());
    for (std::size_t i = 0; i < order.size(); ++i) rank[order[i]] = static_cast<double>(i);
    return rank;
  };
  const auto a = ranks([](const auto&p) { return p.first; }), b = ranks([](const auto&p) { return p.second; });
  const auto n = static_cast<double>(pairs.size());
  double sum = 0;
  for (std::size_t i = 0; i < a.size(); ++i) sum += (a[i] - b[i]) * (a[i] - b[i]);
  return 1 - 6 * sum / (n * (n * n - 1));
}

Result<void> run_one(const fs::path& path, const Setup& setup, const MachineProfile& machine) {
  const double layer_mm = setup.layer_mm > 0 ? setup.layer_mm : machine.layers.thickness_mm;
  const auto bytes = read_file(path, kMaxBytes);
  if (!bytes) return tl::unexpected{bytes.error()};
  const std::string name = path.filename().string();
  std::vector<scan::StageTime> times;
  scan::StageClock clock{times};
  const auto prepared = scan::prepare_scan(*bytes, name, {}, {}, clock, {});
  if (!prepared) return tl::unexpected{prepared.error()};
  const double scale = setup.largest_mm / scan::size_of(prepared->cloud).maxCoeff();
  scan::SliceRequest request;
  request.machine = machine;
  request.placement.scale = scale;
  // Contours alone are asked for, no certificates.
  request.method = scan::TraceMethod::Grid;
  request.layer_mm = layer_mm;
  scan::StandingOptions options;
  options.machine = machine;
  options.layer_mm = layer_mm;
  options.scale = scale;

  const double began = now_s();
  const auto judged = scan::judged_standings(prepared->cloud, options, {}, {});
  if (!judged) return tl::unexpected{judged.error()};
  const double judged_s = now_s() - began;
  const auto few = scan::best_apart(*judged, setup.shortlist, 20);
  if (setup.estimate_only) {
    fmt::print("{}: {:.2f} s\n", name, judged_s);
    for (const auto& s : few) print_row("chosen", s, fail(ErrorCode::NotFound, "-"));
    if (!setup.all) return {};
    options.directions = setup.spread;
    options.in_full = 1000;
    const auto spread = scan::judged_standings(prepared->cloud, options, {}, {});
    if (!spread) return tl::unexpected{spread.error()};
    for (const auto& s : *spread)
      if (s.source == scan::StandingSource::Spread) print_row("spread", s, fail(ErrorCode::NotFound, "-"));
    return {};
  }
  const double planning = now_s();
  std::optional<Planned> choice;
  Planned best_of_few{1e300, 1, 0};
  for (const auto& s : few) {
    const auto plan = planned(*bytes, name, request, s.turn);
    if (setup.all) print_row("chosen", s, plan);
    if (!plan) continue;
    if (!choice) choice = *plan;
    if (plan->support_mm3 < best_of_few.support_mm3) best_of_few = *plan;
  }
  const double planned_s = now_s() - planning;

  options.directions = setup.spread;
  options.in_full = 1000;
  const auto spread = scan::judged_standings(prepared->cloud, options, {}, {});
  if (!spread) return tl::unexpected{spread.error()};
  Planned best{1e300, 1, 0};
  std::size_t count = 0;
  std::vector<std::pair<double, double>> pairs;
  std::vector<double> all;
  for (const auto& s : *spread) {
    if (s.source != scan::StandingSource::Spread) continue;
    const auto plan = planned(*bytes, name, request, s.turn);
    if (setup.all) print_row("spread", s, plan);
    if (!plan) continue;
    ++count;
    pairs.emplace_back(s.figures.support_mm3, plan->support_mm3);
    all.push_back(plan->support_mm3);
    if (plan->support_mm3 < best.support_mm3) best = *plan;
  }
  std::sort(all.begin(), all.end());
  if (all.empty() || !choice) return fail(ErrorCode::NotConverged, "nothing could be planned");
  fmt::print("| {} | {:.1f} | {:.1f} | {:.1f} | {:.1f} | {:.2f} | {:.2f} | {:.2f} | {} | {:.1f} | {:.1f} |\n", name,
             choice->support_mm3, best_of_few.support_mm3, best.support_mm3, all[all.size() / 2],
             choice->support_mm3 / best.support_mm3, best_of_few.support_mm3 / best.support_mm3,
             rank_correlation(pairs), count, judged_s, planned_s);
  return {};
}

int run(int argc, char** argv) {
  Setup setup;
  for (int i = 1; i < argc; ++i) {
    const std::string word = argv[i];
    if (word == "--all")
      setup.all = true;
    else if (word == "--estimate")
      setup.estimate_only = true;
    else if (word == "--layer-mm" && i + 1 < argc)
      setup.layer_mm = std::atof(argv[++i]);
    else if (word == "--largest-mm" && i + 1 < argc)
      setup.largest_mm = std::atof(argv[++i]);
    else if (word == "--spread" && i + 1 < argc)
      setup.spread = static_cast<std::uint32_t>(std::atoi(argv[++i]));
    else if (word == "--shortlist" && i + 1 < argc)
      setup.shortlist = static_cast<std::size_t>(std::atoi(argv[++i]));
    else if (word == "--machine" && i + 1 < argc)
      setup.machine = argv[++i];
    else if (!word.starts_with("--"))
      setup.scans.emplace_back(word);
    else {
      fmt::print(stderr,
                 "campaign_orient [--all] [--estimate] [--layer-mm MM] [--largest-mm MM] [--spread N] "
                 "[--shortlist N] [--machine NAME] FILE...\n");
      return 1;
    }
  }
  const auto known = builtin_profiles();
  if (!known) return 1;
  const auto machine = find_machine(known->machines(), setup.machine);
  if (!machine) return 1;
  fmt::print(
      "supports in mm3 by the planner: of the first choice, of the best of the shortlist, of the best and of the "
      "median of {} spread directions\n",
      setup.spread);
  fmt::print(
      "| object | choice | shortlist | best of spread | median | choice/best | shortlist/best | rank correlation "
      "| judged | s estimate | s planner |\n|---|---|---|---|---|---|---|---|---|---|---|\n");
  int failed = 0;
  for (const fs::path& path : setup.scans) {
    if (const auto ok = run_one(path, setup, *machine); !ok) {
      fmt::print("| {} | {} |\n", path.filename().string(), ok.error().what);
      ++failed;
    }
    std::fflush(stdout);
  }
  return failed;
}

}  // namespace
}  // namespace telefab

int main(int argc, char** argv) { return telefab::run(argc, argv); }
