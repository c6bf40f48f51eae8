// SPDX-License-Identifier: GPL-3.0-or-later
#include <fmt/format.h>

#include <memory>
#include <telefab/base/file.hpp>
#include <telefab/codec/tfc_file.hpp>
#include <telefab/command_line/machine_choice.hpp>
#include <telefab/command_line/output.hpp>
#include <telefab/fab/formats/foreign_print.hpp>
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

constexpr std::uint64_t kMostBytes = 4ULL << 30U;

/// What is to be planned: contours of a scan site, or what another program cut.
struct Given {
  LayerStack stack;
  FileBytes tfc;                            ///< the file as it came; none: it was another
  std::shared_ptr<const ReadyPrint> ready;  ///< of a file of masks
};

Result<Given> given_print(const Options& o, const FileBytes& bytes, const MachineProfile& machine,
                          const std::stop_token& stop) {
  auto foreign =
      read_foreign_print(bytes, machine, std::filesystem::path{o.stack}.filename().string(), progress_line(), stop);
  clear_progress();
  if (!foreign) return fail_in(o.stack, foreign.error());
  return Given{std::move(foreign->stack), nullptr, std::move(foreign->ready)};
}

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
  if (s.price)
    write_output(fmt::format("resin {:.1f} ml for {:.2f} {}, at {} a litre\n", s.resin_ml(),
                             s.price->of_ml(s.resin_ml()), s.price->currency, s.price->per_litre));
  write_output(fmt::format("supports {:.2f} s, masks {:.2f} s, loads {:.2f} s; written to {}{}\n", s.support_seconds,
                           s.mask_seconds, s.carry_seconds, folder,
                           replaced ? ", in place of the plan that lay there" : ""));
  write_output(
      fmt::format("before printing:{}\n{}", preflight.holds() ? " the job would be held" : "", to_text(preflight)));
}

Result<ExitCode> run(const Options& o, std::stop_token stop) {
  auto options = plan_options(o);
  if (!options) return tl::unexpected{options.error()};
  auto read = read_file(o.stack, kMostBytes);
  if (!read) return tl::unexpected{read.error()};
  const auto bytes = std::make_shared<const std::vector<std::byte>>(std::move(*read));
  const bool is_ours = is_tfc(*bytes) || !is_foreign_print(*bytes);  // what is neither is refused as a .tfc
  auto stack = is_ours ? read_tfc(*bytes).map([](LayerStack s) { return std::optional{std::move(s)}; })
                       : Result<std::optional<LayerStack>>{std::nullopt};
  if (!stack) return fail_in(o.stack, stack.error());
  const auto chosen = chosen_profile(o.machine, *stack ? (*stack)->header().machine : std::string{});
  if (!chosen) return tl::unexpected{chosen.error()};
  const MachineProfile* const machine = &chosen->profile;
  options->price = chosen->price;
  auto given =
      *stack ? Result<Given>{Given{std::move(**stack), bytes, nullptr}} : given_print(o, bytes, *machine, stop);
  if (!given) return tl::unexpected{given.error()};
  if (given->ready) {
    options->ready = given->ready;
    options->masks = MaskMethod::Cover;
    options->supports.mode = SupportOptions::Mode::None;
  }
  const SystemClock clock;
  std::error_code unknown;  // a folder that cannot be looked at is refused below
  const bool replaced = std::filesystem::exists(std::filesystem::path{o.out} / "plan.json", unknown);
  const auto summary = write_plan_folder(o.out, given->stack, *machine, *options, clock, progress_line(), stop,
                                         given->tfc ? std::span{*given->tfc} : std::span<const std::byte>{});
  clear_progress();
  if (!summary) return tl::unexpected{summary.error()};
  const Preflight preflight = preflight_of(given->stack, *machine, *summary);
  if (o.json)
    write_output(to_json(*summary));
  else
    print_summary(*summary, preflight, o.out, replaced);
  return preflight.holds() ? ExitCode::NotCertified : ExitCode::Ok;
}

}  // namespace

VerbBody declare_plan(VerbOptions& options) {
  auto o = std::make_shared<Options>();
  options
      .add("FILE", o->stack,
           "contour file (.tfc) of telefab-scan slice; or, for --machine, what another program cut: masks (SL1, "
           "NanoDLP, "
           "GOO), printed as they are, or contours (CLI, SVG, 3MF with slices)")
      .required();
  declare_machine_choice(options, o->machine, "machine profile; default: the one it was sliced for",
                         MachineIs::Optional);
  options
      .add_output("--out", o->out,
                  "folder for masks, plan.json, supports.json, preview.png, report.json, preflight.json")
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
