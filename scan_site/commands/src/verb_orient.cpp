// SPDX-License-Identifier: GPL-3.0-or-later
#include <fmt/format.h>
#include <tbb/global_control.h>
#include <algorithm>
#include <array>
#include <cmath>
#include <memory>
#include <nlohmann/json.hpp>
#include <telefab/base/file.hpp>
#include <telefab/base/json_text.hpp>
#include <telefab/codec/tfc_file.hpp>
#include <telefab/command_line/machine_choice.hpp>
#include <telefab/command_line/output.hpp>
#include <telefab/command_line/slice_options.hpp>
#include <telefab/job/readable_scans.hpp>
#include <telefab/scan/formats/read_cloud.hpp>
#include <telefab/scan/inspect/standing_picture.hpp>
#include <telefab/scan/placing/standing.hpp>
#include <telefab/scan/slicing/job_parameters.hpp>
#include <telefab/scan/slicing/standings.hpp>

#include "cloud_files.hpp"
#include "planner.hpp"
#include "verbs.hpp"

namespace telefab::scan {
namespace {

/// What decides what the part is and how large; how it stands is the question.
constexpr std::array<std::string_view, 13> kSizing{
    "height_mm", "scale",        "fit",          "units",    "mirror",   "scale_axes",   "crop",
    "pieces",    "sample_faces", "thickness_mm", "layer_mm", "complete", "keep_outliers"};
/// Directions that are sliced and planned before one is the best.
constexpr std::size_t kShortlist = 8;
/// They differ by so much.
constexpr double kApartDeg = 20;
/// Thicker layers judge a tall part as well, and sooner.
constexpr double kMostLayers = 400;

struct Options {
  std::string cloud;
  MachineChoice machine;
  SliceParameters asked;
  std::string by = "supports";
  std::uint32_t best = 6;
  std::uint32_t directions = 300;
  std::string planner, picture;
  bool json = false;
  unsigned threads = 0;
};

/// A way to stand with all that is known of it.
struct Candidate {
  Standing standing;  ///< its figures hold the planner's where there are any
  std::optional<SliceReport> slices;
  std::optional<PlannedSupports> planned;
  std::string failure;  ///< why it could not be sliced or planned; for people
};

struct Bench {
  std::span<const std::byte> scan;
  std::string name;
  SliceRequest request;
  const std::optional<Planner>& planner;
  std::filesystem::path folder;  ///< for stacks; holds the machine's profile
};

/// Slices a candidate, and plans its supports where there is a planner.
Result<void> look_at(Candidate& candidate, const Bench& bench, std::stop_token stop) {
  SliceRequest request = bench.request;
  request.placement.turn = candidate.standing.turn;
  std::vector<std::byte> stack;
  std::optional<TfcWriter> writer;
  const LayerSink sink = [&](const StackHeader& header, Layer&& layer) -> Result<void> {
    if (!bench.planner) return {};
    if (!writer) {
      CodecOptions codec;
      codec.coding = Coding::Exact;
      auto started = TfcWriter::start(header, codec, [&](std::span<const std::byte> bytes) -> Result<void> {
        stack.insert(stack.end(), bytes.begin(), bytes.end());
        return {};
      });
      if (!started) return tl::unexpected{started.error()};
      writer = std::move(*started);
    }
    return writer->add(layer);
  };
  auto sliced = slice_scan(bench.scan, bench.name, request, sink, {}, stop);
  if (!sliced) {
    if (sliced.error().code == ErrorCode::Cancelled) return tl::unexpected{sliced.error()};
    candidate.failure = sliced.error().what;
    return {};
  }
  candidate.slices = std::move(*sliced);
  if (!writer) return {};
  if (auto digest = writer->finish(); !digest) return tl::unexpected{digest.error()};
  const auto file = bench.folder / "stack.tfc";
  if (auto ok = write_file_atomically(file, stack); !ok) return ok;
  const auto planned =
      bench.planner->supports(file, request.machine.name, bench.folder / "machines", request.threads, stop);
  if (!planned) {
    if (planned.error().code != ErrorCode::InvalidInput) return tl::unexpected{planned.error()};
    candidate.failure = planned.error().what;
    return {};
  }
  candidate.planned = *planned;
  StandingFigures& f = candidate.standing.figures;
  f.support_mm3 = planned->support_mm3;
  f.part_mm3 = planned->part_mm3;
  f.anchors = planned->anchors;
  f.is_lifted = planned->lifted_mm > 0;
  return {};
}

double share(double part, double whole) { return whole > 0 ? 100 * part / whole : 0; }

/// By the goal, those that failed last.
void sort_by_goal(std::vector<Candidate>& candidates, StandFor goal) {
  std::vector<Standing> standings;
  for (const Candidate& c : candidates) standings.push_back(c.standing);
  rank(standings, goal);
  const auto place = [&](const Candidate& c) {
    const auto at = std::ranges::find(standings, c.standing.turn, &Standing::turn) - standings.begin();
    return at + (c.failure.empty() ? 0 : static_cast<std::ptrdiff_t>(standings.size()));
  };
  std::ranges::stable_sort(candidates, {}, place);
}

double doubtful_percent(const SliceReport& report) {
  return share(static_cast<double>(report.flagged.size()), report.layers_cut);
}

void print_row(const std::string& rank, const Candidate& c) {
  const StandingFigures& f = c.standing.figures;
  std::string doubt = "      -       -";
  if (c.slices)
    doubt =
        fmt::format("{:>7.1f} {:>7.1f}", doubtful_percent(*c.slices), share(c.slices->completed, c.slices->layers_cut));
  write_output(fmt::format("{:>4} {:>9.1f} {:>7.2f} {:>7} {:>8.1f} {:>6.1f} {:>6} {:>8.1f} {:>6.2f} {}  {:<14} {}\n",
                           rank, f.support_mm3, share(f.support_mm3, f.part_mm3), f.anchors, f.overhang_mm2,
                           f.size_mm.z(), f.layers, f.trapped_mm3, f.stability, doubt, name_of(c.standing.source),
                           rotate_text(c.standing.turn)));
  if (!c.failure.empty()) write_output(fmt::format("     {}\n", c.failure));
}

void print_table(const std::vector<Candidate>& best, const Candidate* as_in_file, const Options& o,
                 const std::string& judge) {
  write_output(fmt::format("best for {}; supports judged by {}\n", o.by, judge));
  write_output(fmt::format("{:>4} {:>9} {:>7} {:>7} {:>8} {:>6} {:>6} {:>8} {:>6} {:>7} {:>7}  {:<14} {}\n", "rank",
                           "supports", "of part", "anchors", "overhang", "height", "layers", "trapped", "stable",
                           "doubt", "compl.", "found as", "--rotate"));
  write_output(fmt::format("{:>4} {:>9} {:>7} {:>7} {:>8} {:>6} {:>6} {:>8} {:>6} {:>7} {:>7}\n", "", "mm3", "%", "",
                           "mm2", "mm", "", "mm3", "", "%", "%"));
  for (std::size_t i = 0; i < best.size(); ++i) print_row(std::to_string(i + 1), best[i]);
  if (as_in_file) print_row("file", *as_in_file);
  if (!best.empty()) write_output(fmt::format("slice with --rotate {}\n", rotate_text(best.front().standing.turn)));
}

nlohmann::ordered_json json_of(const Candidate& c) {
  using nlohmann::ordered_json;
  const Eigen::Matrix3d& m = c.standing.turn.matrix();
  ordered_json rows = ordered_json::array();
  for (int r = 0; r < 3; ++r)
    for (int k = 0; k < 3; ++k) rows.push_back(m(r, k));
  ordered_json one{{"rotate", rotate_text(c.standing.turn)},
                   {"matrix", rows},
                   {"up", {m(2, 0), m(2, 1), m(2, 2)}},
                   {"found_as", name_of(c.standing.source)},
                   {"figures", json_or_discarded(to_json(c.standing.figures))}};
  one["judged_by"] = c.planned ? "planner" : "estimate";
  if (c.slices)
    one["slices"] = {{"layers", c.slices->layers_cut},
                     {"certified", c.slices->certified},
                     {"completed", c.slices->completed},
                     {"flagged", c.slices->flagged.size()}};
  if (!c.failure.empty()) one["failure"] = c.failure;
  return one;
}

std::vector<std::string> caption(const std::string& rank, const Candidate& c) {
  const StandingFigures& f = c.standing.figures;
  std::vector<std::string> lines{
      fmt::format("{}: {:.0f} mm3 supports, {:.2f} %", rank, f.support_mm3, share(f.support_mm3, f.part_mm3)),
      fmt::format("{} anchors, {:.0f} mm2 overhang", f.anchors, f.overhang_mm2),
      fmt::format("{:.1f} mm high, {} layers", f.size_mm.z(), f.layers),
      fmt::format("stability {:.2f}, {:.0f} mm3 trapped", f.stability, f.trapped_mm3)};
  if (c.slices) lines.push_back(fmt::format("{:.1f} % of the layers doubtful", doubtful_percent(*c.slices)));
  lines.push_back("--rotate " + rotate_text(c.standing.turn));
  return lines;
}

Result<void> write_picture(const std::string& path, const PointCloud& cloud, const std::vector<Candidate>& best,
                           const Candidate* as_in_file, PictureCaption about) {
  std::vector<StandingTile> tiles;
  for (std::size_t i = 0; i < best.size(); ++i)
    tiles.push_back({best[i].standing.turn, caption(std::to_string(i + 1), best[i])});
  if (as_in_file) tiles.push_back({as_in_file->standing.turn, caption("file", *as_in_file)});
  const auto png = encode_png(draw_standings(cloud, tiles, std::move(about)));
  if (!png) return tl::unexpected{png.error()};
  return write_file_atomically(path, *png);
}

/// Percent of the work on a terminal.
class Bar {
 public:
  void show(std::string_view what, double done) {
    const int percent = static_cast<int>(100 * done);
    if (!is_terminal_ || (percent == shown_ && what == what_)) return;
    shown_ = percent;
    what_ = what;
    write_note(fmt::format("\r{:<24} {:3} %", what, percent));
  }
  void clear() const {
    if (shown_ >= 0) write_note(fmt::format("\r{:40}\r", ""));
  }

 private:
  bool is_terminal_ = on_terminal();
  int shown_ = -1;
  std::string what_;
};

Result<ExitCode> run(const Options& o, std::stop_token stop) {
  const auto goal = stand_for_from(o.by);
  if (!goal) return tl::unexpected{goal.error()};
  const auto machine = chosen_machine(o.machine);
  if (!machine) return tl::unexpected{machine.error()};
  const auto parameters = job_parameters_of(o.asked, *machine, Contours::Plain);
  if (!parameters) return tl::unexpected{parameters.error()};
  const auto planner = Planner::find(o.planner);
  if (!planner) return tl::unexpected{planner.error()};
  const auto scan = read_file(o.cloud, kMaxScanFileBytes);
  if (!scan) return tl::unexpected{scan.error()};
  std::optional<tbb::global_control> threads;
  if (o.threads > 0) threads.emplace(tbb::global_control::max_allowed_parallelism, o.threads);

  SliceRequest request = parameters->slice;
  request.threads = o.threads;
  IntakeOptions intake = request.intake;
  intake.pick.keep_outliers |= !request.mls.drop_outliers;
  Bar bar;
  bar.show("reading", 0);
  std::vector<StageTime> times;
  StageClock clock{times};
  const auto prepared = prepare_scan(*scan, name_of_file(o.cloud), intake, {}, clock, stop);
  if (!prepared) return tl::unexpected{prepared.error()};
  for (const std::string& warning : prepared->warnings) write_note(fmt::format("warning: {}\n", warning));
  const auto all = standings_of(
      prepared->cloud, request, {*goal, o.directions}, [&](double done) { bar.show("judging directions", done); },
      stop);
  if (!all) return fail_in(name_of_file(o.cloud), all.error());

  std::vector<Candidate> candidates;
  for (Standing& s : best_apart(*all, *planner ? std::max<std::size_t>(kShortlist, o.best) : o.best, kApartDeg))
    candidates.push_back({std::move(s), {}, {}, {}});
  const auto lies = std::ranges::find(*all, StandingSource::AsInFile, &Standing::source);
  const bool is_listed =
      std::ranges::any_of(candidates, [](const Candidate& c) { return c.standing.source == StandingSource::AsInFile; });
  const bool has_file_row = lies != all->end() && !is_listed;
  if (has_file_row) candidates.push_back({*lies, {}, {}, {}});

  double tallest = 0;
  for (const Candidate& c : candidates) tallest = std::max(tallest, c.standing.figures.size_mm.z());
  request.layer_mm =
      std::min(1.0, std::max(request.layer_mm.value_or(machine->layers.thickness_mm), tallest / kMostLayers));
  const auto folder = WorkFolder::make();
  if (!folder) return tl::unexpected{folder.error()};
  // In a folder of its own: beside the work folder lie files of others.
  std::error_code error;
  std::filesystem::create_directory(folder->path() / "machines", error);
  if (auto ok = write_file_atomically(folder->path() / "machines/machine.toml", to_toml(*machine)); !ok)
    return tl::unexpected{ok.error()};
  const Bench bench{*scan, name_of_file(o.cloud), request, *planner, folder->path()};
  for (std::size_t i = 0; i < candidates.size(); ++i) {
    bar.show(*planner ? "slicing and planning" : "slicing",
             static_cast<double>(i) / static_cast<double>(candidates.size()));
    if (auto ok = look_at(candidates[i], bench, stop); !ok) return tl::unexpected{ok.error()};
  }
  bar.clear();

  std::optional<Candidate> as_in_file;
  if (has_file_row) {
    as_in_file = std::move(candidates.back());
    candidates.pop_back();
  }
  sort_by_goal(candidates, *goal);
  candidates.resize(std::min<std::size_t>(candidates.size(), o.best));
  const std::string judge = *planner
                                ? fmt::format("{} on layers of {:g} mm", (*planner)->program(), *request.layer_mm)
                                : std::string{"an estimate from points; the program telefab-fab would judge better"};
  if (!o.picture.empty()) {
    const auto& mirror = request.placement.mirror;
    const PointCloud cloud = mirror ? mirrored(prepared->cloud, *mirror) : prepared->cloud;
    PictureCaption about{name_of_file(o.cloud),
                         machine->name,
                         {},
                         fmt::format("ways to stand, the best first; judged on layers of {:g} mm", *request.layer_mm),
                         {},
                         0,
                         {}};
    if (auto ok = write_picture(o.picture, cloud, candidates, as_in_file ? &*as_in_file : nullptr, std::move(about));
        !ok)
      return tl::unexpected{ok.error()};
  }
  if (!o.json) {
    print_table(candidates, as_in_file ? &*as_in_file : nullptr, o, judge);
    return ExitCode::Ok;
  }
  nlohmann::ordered_json json{{"scan", name_of_file(o.cloud)},
                              {"machine", machine->name},
                              {"by", o.by},
                              {"judged_by", judge},
                              {"layer_mm", *request.layer_mm},
                              {"judged_in_full", all->size()},
                              {"best", nlohmann::ordered_json::array()}};
  for (const Candidate& c : candidates) json["best"].push_back(json_of(c));
  json["as_in_file"] = as_in_file ? json_of(*as_in_file) : nlohmann::ordered_json(nullptr);
  write_output(json_text(json) + "\n");
  return ExitCode::Ok;
}

}  // namespace

VerbBody declare_orient(VerbOptions& options) {
  auto o = std::make_shared<Options>();
  options.add("CLOUD", o->cloud, fmt::format("scan: {}", kReadableScans)).required();
  declare_machine_choice(options, o->machine, "machine profile whose supports and platform count", MachineIs::Required);
  options
      .add("--by", o->by,
           "what is best: least supports, least height (that is time), or quality: least surface that supports and the "
           "steps of layers mark")
      .one_of({"supports", "height", "quality"})
      .shows_default();
  options.add("--best", o->best, "how many ways to stand are shown; they differ by 20 degrees and more")
      .within(1, 12)
      .shows_default();
  options
      .add("--directions", o->directions,
           "how many directions are judged, spread evenly; axes and flat sides come on top")
      .within(1, 5000)
      .shows_default();
  options.add("--planner", o->planner,
              "the program that judges the shortlist by planning its supports, or none: an estimate judges; default: "
              "telefab-fab beside this program or in PATH");
  options.add_output("--picture", o->picture, "write the object as it would stand each way here (PNG)");
  declare_slice_parameters(options, o->asked, kSizing, check_text);
  options.add("--threads", o->threads, "worker threads; 0: one a core").shows_default();
  options.flag("--json", o->json, "print everything as JSON");
  options.footer(
      "All directions are judged from points: what no layer below carries, pins under it, cups that keep liquid. The\n"
      "best are sliced and, where the planner is here, supported as they would be printed. Print one of them with the\n"
      "--rotate of its row; telefab-scan slice --up auto takes the best estimate by itself.\n"
      "  supports  volume of all supports, and as share of the part\n"
      "  overhang  what supports have to hold, seen from below\n"
      "  trapped   the most liquid that stays in cups and hollows while the part grows\n"
      "  stable    how far inside its footing its middle is, over the height of that; below 0 it would fall over\n"
      "  doubt     layers that are not certified; compl.: certified ones with stretches nobody measured\n");
  return [o](std::stop_token stop) { return run(*o, stop); };
}

}  // namespace telefab::scan
