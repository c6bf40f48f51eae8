// SPDX-License-Identifier: GPL-3.0-or-later
#include <fmt/format.h>

#include <memory>
#include <telefab/base/file.hpp>
#include <telefab/command_line/machine_choice.hpp>
#include <telefab/command_line/output.hpp>
#include <telefab/fab/planning/plan_folder.hpp>
#include <telefab/fab/planning/preflight.hpp>

#include "contour_limit_options.hpp"
#include "mask_options.hpp"
#include "read_stack.hpp"
#include "support_choice.hpp"
#include "verbs.hpp"

namespace telefab::fab {
namespace {

struct Options {
  std::string stack;
  MachineChoice machine;
  std::string out;
  MaskOptions masks;
  ContourLimitOptions contour_limits;
  SupportChoice support;
  int threads = 0;
  bool json = false;
};

Result<PlanOptions> plan_options(const Options& o) {
  PlanOptions options;
  options.job = std::filesystem::path{o.stack}.stem().string();
  if (auto ok = apply(o.masks, options); !ok) return tl::unexpected{ok.error()};
  if (auto ok = apply(o.support, options.supports); !ok) return tl::unexpected{ok.error()};
  options.threads = o.threads;
  options.contour_limits = o.contour_limits.limits();
  return options;
}

void print_summary(const PlanSummary& s, const Preflight& preflight, const std::string& folder, bool replaced) {
  write_output(fmt::format("{} layers on {} ({} of the part, {} below it), {} anchors\n", s.plan.layers.size(),
                           s.plan.machine, s.part_layers, s.elevation_layers, s.anchors.size()));
  write_output(fmt::format("part {:.1f} mm3, supports {:.1f} mm3; {:.0f} min of print, of that {:.0f} min of light\n",
                           s.figures.part_mm3, s.figures.support_mm3, s.print_s / 60, s.exposure_s / 60));
  write_output(fmt::format("supports {:.2f} s, masks {:.2f} s, loads {:.2f} s; written to {}{}\n", s.support_seconds,
                           s.mask_seconds, s.carry_seconds, folder,
                           replaced ? ", in place of the plan that lay there" : ""));
  write_output(
      fmt::format("before printing:{}\n{}", preflight.holds() ? " the job would be held" : "", to_text(preflight)));
}

Result<ExitCode> run(const Options& o, std::stop_token stop) {
  const auto options = plan_options(o);
  if (!options) return tl::unexpected{options.error()};
  const auto file = read_stack_file(o.stack);
  if (!file) return tl::unexpected{file.error()};
  const auto machine = chosen_machine(o.machine, file->stack.header().machine);
  if (!machine) return tl::unexpected{machine.error()};
  const SystemClock clock;
  std::error_code unknown;  // a folder that cannot be looked at is refused below
  const bool replaced = std::filesystem::exists(std::filesystem::path{o.out} / "plan.json", unknown);
  const auto summary =
      write_plan_folder(o.out, file->stack, *machine, *options, clock, progress_line(), stop, file->bytes);
  clear_progress();
  if (!summary) return tl::unexpected{summary.error()};
  const Preflight preflight = preflight_of(file->stack, *machine, *summary);
  if (o.json)
    write_output(to_json(*summary));
  else
    print_summary(*summary, preflight, o.out, replaced);
  return preflight.holds() ? ExitCode::NotCertified : ExitCode::Ok;
}

}  // namespace

VerbBody declare_plan(VerbOptions& options) {
  auto o = std::make_shared<Options>();
  options.add("FILE", o->stack, "contour file (.tfc) of telefab-scan slice").required();
  declare_machine_choice(options, o->machine, "machine profile; default: the one it was sliced for",
                         MachineIs::Optional);
  options.add("--out", o->out, "folder for masks, plan.json, supports.json, preview.png, report.json, preflight.json")
      .required();
  declare_mask_options(options, o->masks);
  declare_contour_limits(options, o->contour_limits);
  declare_support_choice(options, o->support);
  options.add("--threads", o->threads, "0: all cores; the plan is the same for any number")
      .within(0, 1024)
      .shows_default();
  options.flag("--json", o->json, "print the report as JSON");
  options.footer(
      "Exit code 8: planned and written, but something holds the job; preflight.json and the lines above say what.");
  return [o](std::stop_token stop) { return run(*o, stop); };
}

}  // namespace telefab::fab
