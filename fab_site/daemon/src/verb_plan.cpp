#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <cmath>
#include <memory>
#include <telefab/base/file.hpp>
#include <telefab/fab/planning/plan_folder.hpp>
#include <telefab/fab/planning/preflight.hpp>

#include "read_stack.hpp"
#include "verbs.hpp"

namespace telefab::fab {
namespace {

constexpr std::uint64_t kMaxHandListBytes = 16U << 20U;

struct Options {
  std::string stack;
  std::string machine;
  std::string machines = default_machine_folder();
  std::string out;
  std::string masks = "blend-stack";
  double deadline_s = 0;
  int iterations = 20;
  double support_grey = 1;
  double cure_depth_layers = 0;
  bool plain_undersides = false;
  std::string supports = "auto";
  std::string stand = "auto";
  std::string hand_list;
  int threads = 0;
  bool json = false;
};

Result<PlanOptions> plan_options(const Options& o) {
  PlanOptions options;
  options.job = std::filesystem::path{o.stack}.stem().string();
  const auto masks = mask_method_from_name(o.masks);
  if (!masks) return tl::unexpected{masks.error()};
  options.masks = *masks;
  options.mask_deadline = std::chrono::nanoseconds{std::llround(o.deadline_s * 1e9)};
  options.mask_iterations = o.iterations;
  options.support_grey = o.support_grey;
  options.cure_depth_layers = o.cure_depth_layers;
  options.compensate_undersides = !o.plain_undersides;
  options.supports.mode = o.supports == "none" ? SupportOptions::Mode::None : SupportOptions::Mode::Auto;
  options.supports.stand = o.stand == "always"  ? SupportOptions::Stand::Always
                           : o.stand == "never" ? SupportOptions::Stand::Never
                                                : SupportOptions::Stand::Auto;
  options.threads = o.threads;
  if (!o.hand_list.empty()) {
    const auto text = read_file(o.hand_list, kMaxHandListBytes);
    if (!text) return tl::unexpected{text.error()};
    auto hand = hand_list_from_json({reinterpret_cast<const char*>(text->data()), text->size()});
    if (!hand) return fail_in(o.hand_list, hand.error());
    options.supports.hand = std::move(*hand);
  }
  return options;
}

void print_summary(const PlanSummary& s, const Preflight& preflight, const std::string& folder) {
  fmt::print("{} layers on {} ({} of the part, {} below it), {} anchors\n", s.plan.layers.size(), s.plan.machine,
             s.part_layers, s.lift_layers, s.anchors);
  fmt::print("part {:.1f} mm3, supports {:.1f} mm3; {:.0f} min of print, of that {:.0f} min of light\n",
             s.figures.part_mm3, s.figures.support_mm3, s.print_s / 60, s.exposure_s / 60);
  if (s.masks != MaskMethod::Cover)
    fmt::print("masks by {}: {:.0f} px of contour solved to {:.4f} px rms{}\n", name_of(s.masks),
               s.mask_figures.length_px, s.mask_figures.residual_px(),
               s.mask_figures.unsolved == 0
                   ? std::string{}
                   : fmt::format(", {} of {} tiles left as cover when time was out", s.mask_figures.unsolved,
                                 s.mask_figures.unsolved + s.mask_figures.tiles));
  fmt::print("supports {:.2f} s, masks {:.2f} s; written to {}\n", s.support_seconds, s.mask_seconds, folder);
  fmt::print("before printing:{}\n{}", preflight.holds() ? " the job would be held" : "", to_text(preflight));
}

Result<ExitCode> run(const Options& o, std::stop_token stop) {
  const auto options = plan_options(o);
  if (!options) return tl::unexpected{options.error()};
  const auto file = read_stack_file(o.stack);
  if (!file) return tl::unexpected{file.error()};
  const auto machine = machine_for(file->stack, o.machine, o.machines);
  if (!machine) return tl::unexpected{machine.error()};
  const SystemClock clock;
  const auto summary =
      write_plan_folder(o.out, file->stack, *machine, *options, clock, progress_line(), stop, file->bytes);
  clear_progress();
  if (!summary) return tl::unexpected{summary.error()};
  const Preflight preflight = preflight_of(file->stack, *machine, *summary);
  if (o.json)
    fmt::print("{}", to_json(*summary));
  else
    print_summary(*summary, preflight, o.out);
  return preflight.holds() ? ExitCode::NotCertified : ExitCode::Ok;
}

}  // namespace

VerbBody declare_plan(CLI::App& options) {
  auto o = std::make_shared<Options>();
  options.add_option("FILE", o->stack, "contour file (.tfc) of telefab-scan slice")->required();
  options.add_option("--machine", o->machine, "machine profile; default: the one it was sliced for");
  options.add_option("--machines", o->machines, "folder of machine profiles (*.toml)")->capture_default_str();
  options
      .add_option("--out", o->out,
                  "folder for masks, plan.json, supports.json, preview.png, report.json, preflight.json")
      ->required();
  options
      .add_option("--masks", o->masks,
                  "how grey levels are found: cover (area of each pixel), blend (solved, each layer's own light), "
                  "blend-stack (solved for the light of all layers)")
      ->check(CLI::IsMember({"cover", "blend", "blend-stack"}))
      ->capture_default_str();
  options
      .add_option(
          "--mask-deadline-s", o->deadline_s,
          "most seconds for solving one mask, the rest of it keeps its cover; 0: no limit, same bytes on every run")
      ->check(CLI::Range(0.0, 3600.0))
      ->capture_default_str();
  options.add_option("--mask-iterations", o->iterations, "steps of the solver")
      ->check(CLI::Range(1, 1000))
      ->capture_default_str();
  options.add_option("--support-grey", o->support_grey, "light of supports as share of white; solved masks only")
      ->check(CLI::Range(0.05, 1.0))
      ->capture_default_str();
  options
      .add_option("--cure-depth", o->cure_depth_layers,
                  "layers that one exposure cures deep: times follow from resin and irradiance; 0: the profile's times")
      ->check(CLI::Range(0.0, 20.0))
      ->capture_default_str();
  options.add_flag("--plain-undersides", o->plain_undersides,
                   "blend-stack: give layers over a void their full light although later ones cure through them");
  options.add_option("--supports", o->supports, "none or auto")
      ->check(CLI::IsMember({"none", "auto"}))
      ->capture_default_str();
  options
      .add_option("--stand", o->stand,
                  "stand on the platform: auto (where the first layer is large enough), always, never")
      ->check(CLI::IsMember({"auto", "always", "never"}))
      ->capture_default_str();
  options.add_option("--hand-list", o->hand_list, "JSON file of extra and forbidden places for anchors");
  options.add_option("--threads", o->threads, "0: all cores; the plan is the same for any number")
      ->check(CLI::Range(0, 1024))
      ->capture_default_str();
  options.add_flag("--json", o->json, "print the report as JSON");
  options.footer(
      "Exit code 8: planned and written, but something holds the job; preflight.json and the lines above say what.");
  return [o](std::stop_token stop) { return run(*o, stop); };
}

}  // namespace telefab::fab
