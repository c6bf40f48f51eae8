// SPDX-License-Identifier: GPL-3.0-or-later
#include <fmt/format.h>

#include <filesystem>
#include <map>
#include <memory>
#include <optional>
#include <telefab/base/file.hpp>
#include <telefab/command_line/machine_choice.hpp>
#include <telefab/command_line/output.hpp>
#include <telefab/fab/formats/contour_export.hpp>
#include <telefab/fab/formats/mask_export.hpp>
#include <telefab/fab/mask/raster.hpp>
#include <telefab/fab/planning/plan_folder.hpp>
#include <telefab/fab/planning/preflight.hpp>
#include <telefab/geometry/contour_lines.hpp>
#include <telefab/image/png.hpp>

#include "read_stack.hpp"
#include "verbs.hpp"

namespace telefab::fab {
namespace {

namespace fs = std::filesystem;

struct Options {
  std::string from;
  std::string format;
  std::string out;
  MachineChoice machine;
  bool no_supports = false;
  std::vector<std::string> although;
};

/// What is exported: a plan with its masks, or contours alone.
struct Source {
  std::unique_ptr<PlannedJob> plan;  ///< null for a .tfc file
  std::optional<LayerStack> stack;   ///< of the part; not read where only masks are asked for
};

Result<Source> open_source(const Options& o, bool contours) {
  Source source;
  std::error_code ignored;
  if (fs::is_directory(o.from, ignored)) {
    auto plan = PlannedJob::open(o.from);
    if (!plan) return tl::unexpected{plan.error()};
    source.plan = std::move(*plan);
    if (!contours) return source;
    auto part = source.plan->part();
    if (!part)
      return fail_in("the plan holds no contours of the part; plan the job again, or export its .tfc file",
                     part.error());
    source.stack = std::move(*part);
    return source;
  }
  auto stack = read_stack(o.from);
  if (!stack) return tl::unexpected{stack.error()};
  source.stack = std::move(*stack);
  return source;
}

Result<MachineProfile> machine_of(const Source& source, const Options& o) {
  return chosen_machine(o.machine, source.plan ? source.plan->plan().machine : source.stack->header().machine);
}

Result<ContourJob> job_of(const Source& source, const MachineProfile& machine, const Options& o) {
  const Point2 platform{machine.platform.width_mm, machine.platform.depth_mm};
  if (!source.plan) return contour_job(*source.stack, platform);
  auto supports = source.plan->supports();
  if (!supports) return tl::unexpected{supports.error()};
  if (o.no_supports)
    for (auto& layer : *supports) layer.clear();
  auto job = contour_job(*source.stack, platform, std::move(*supports));
  if (job) job->name = source.plan->plan().job;
  return job;
}

Result<std::uint32_t> export_lines(const ContourJob& job, const Options& o, const std::stop_token& stop) {
  std::string lines;
  for (std::uint32_t i = 0; i < job.layer_count; ++i) {
    if (stop.stop_requested()) return fail(ErrorCode::Cancelled, "the export was cancelled; nothing was written");
    Layer layer;
    layer.index = LayerIndex{i};
    layer.z_mm = cut_height_mm(layer.index, job.thickness_mm);
    auto contours = united(job, i);
    if (!contours) return tl::unexpected{contours.error()};
    layer.contours = std::move(*contours);
    lines += to_json_line(layer) + '\n';
  }
  if (auto ok = write_file_atomically(o.out, lines); !ok) return tl::unexpected{ok.error()};
  return job.layer_count;
}

/// One picture a layer: the masks of a plan, or of contours the part alone by exact area coverage.
Result<std::uint32_t> export_pictures(const Source& source, const MachineProfile& machine, const Options& o,
                                      const std::stop_token& stop) {
  const MaskFrame frame = mask_frame(machine);
  std::error_code error;
  const fs::path folder{o.out};
  fs::create_directories(folder, error);
  if (error) return fail(ErrorCode::NotPermitted, fmt::format("cannot make the folder {}: {}", o.out, error.message()));
  const ProgressSink progress = progress_line();
  const auto count =
      source.plan ? static_cast<std::uint32_t>(source.plan->plan().layers.size()) : source.stack->header().layer_count;
  for (std::uint32_t i = 0; i < count; ++i) {
    if (stop.stop_requested())
      return fail(ErrorCode::Cancelled, fmt::format("the export was cancelled before layer {}", i));
    const auto mask = source.plan ? source.plan->mask(LayerIndex{i})
                                  : Result<Mask>{rasterise(source.stack->layers()[i].contours, frame)};
    if (!mask) return tl::unexpected{mask.error()};
    const auto png = encode_png_grey(mask->size.width_px, mask->size.height_px, mask->rows);
    if (!png) return tl::unexpected{png.error()};
    if (auto done = write_new_file(folder / fmt::format("{:05}.png", i), *png); !done)
      return tl::unexpected{done.error()};
    report(progress, WorkStage::WritingPictures, (i + 1.0) / count);
  }
  if (auto ok = sync_file_system(folder); !ok) return tl::unexpected{ok.error()};
  return count;
}

std::optional<MaskFormat> mask_format_of(std::string_view name) {
  if (name == "sl1") return MaskFormat::Sl1;
  if (name == "nanodlp") return MaskFormat::NanoDlp;
  if (name == "goo") return MaskFormat::Goo;
  return std::nullopt;
}

/// What the readers of an SL1 archive make of the exposures, a line a layer that one of them makes otherwise.
std::string fade_table(const MaskExportReport& report) {
  constexpr std::size_t kMostRows = 24;
  std::map<std::uint32_t, std::map<FadeReader, const FadedLayer*>> rows;
  for (const FadedLayers& fade : report.fades)
    for (const FadedLayer& layer : fade.layers) rows[layer.layer.count()][fade.reader] = &layer;
  if (rows.empty()) return {};
  std::string text =
      fmt::format("exposures in seconds, planned and as printers read numFade = {} (-: as planned)\n{:>6} {:>9}",
                  report.fade, "layer", "planned");
  for (const FadedLayers& fade : report.fades) text += fmt::format(" {:>11}", name_of(fade.reader));
  text += '\n';
  std::size_t shown = 0;
  for (const auto& [layer, made] : rows) {
    if (shown++ == kMostRows) {
      text += fmt::format("  and {} layers more\n", rows.size() - kMostRows);
      break;
    }
    text += fmt::format("{:>6} {:>9.3f}", layer, made.begin()->second->planned_s);
    for (const FadedLayers& fade : report.fades) {
      const auto own = made.find(fade.reader);
      text += own == made.end() ? fmt::format(" {:>11}", "-") : fmt::format(" {:>11.3f}", own->second->made_s);
    }
    text += '\n';
  }
  return text;
}

/// What holds an archive: exposures that its printer would make too far from the planned ones.
std::optional<PreflightItem> held_exposures(const MaskExportReport& report, const MachineProfile& machine) {
  if (report.most_exposure_error <= machine.file.most_exposure_error) return std::nullopt;
  PreflightItem item;
  item.name = "exposures";
  item.verdict = PreflightItem::Verdict::Held;
  item.value = report.most_exposure_error;
  item.text = fmt::format(
      "the printer would expose {} layers otherwise than planned, by up to {:.0f} % (file.most_exposure_error: {:.0f} "
      "%); plan with layers.bottom_count = 1 and layers.transition_count, which the format can say",
      report.other_exposures, 100 * report.most_exposure_error, 100 * machine.file.most_exposure_error);
  return item;
}

Result<std::uint32_t> export_archive(MaskFormat format, Source& source, const MachineProfile& machine, const Options& o,
                                     const std::stop_token& stop) {
  const auto done = export_masks(format, source.plan->plan(), *source.plan, machine, o.out, progress_line(), stop);
  if (!done) return tl::unexpected{done.error()};
  if (done->other_exposures != 0)
    write_note(
        fmt::format("telefab-fab: {} layers get another exposure than planned, by up to {:.1f} %, for this "
                    "format holds two exposures and what lies between\n{}",
                    done->other_exposures, 100 * done->most_exposure_error, fade_table(*done)));
  if (done->other_motions != 0)
    write_note(
        fmt::format("telefab-fab: {} layers move or wait in a way of their own, which this format cannot say; "
                    "they move as the others\n",
                    done->other_motions));
  return done->layers;
}

Result<std::uint32_t> export_as_asked(Source& source, const MachineProfile& machine, const Options& o,
                                      const std::stop_token& stop) {
  if (const auto format = mask_format_of(o.format)) return export_archive(*format, source, machine, o, stop);
  if (o.format == "png") return export_pictures(source, machine, o, stop);
  const auto job = job_of(source, machine, o);
  if (!job) return tl::unexpected{job.error()};
  const auto format = contour_format_from_name(o.format);
  if (!format) return export_lines(*job, o, stop);
  if (auto ok = export_contours(*format, *job, o.out, progress_line(), stop); !ok) return tl::unexpected{ok.error()};
  return job->layer_count;
}

/// A held plan goes to no other printer unless what holds it is named.
Result<void> may_leave(const Source& source, const MachineProfile& machine, const Options& o) {
  if (!source.plan) return {};  // contours alone: no supports and no masks that could be held
  auto preflight = preflight_in(o.from);
  if (!preflight) return tl::unexpected{preflight.error()};
  std::string table;
  if (const auto format = mask_format_of(o.format)) {
    const auto report = survey_export(*format, source.plan->plan(), machine, o.out);
    if (!report) return tl::unexpected{report.error()};
    if (auto held = held_exposures(*report, machine)) {
      preflight->items.push_back(std::move(*held));
      table = fade_table(*report);
    }
  }
  const auto why = let_through(*preflight, fmt::format("{}", fmt::join(o.although, ",")));
  if (!why) {
    write_note(table);
    return fail_in(o.from, why.error());
  }
  if (!why->empty()) write_note(fmt::format("telefab-fab: held, and exported {}\n", *why));
  return {};
}

}  // namespace

VerbBody declare_export(VerbOptions& options) {
  auto o = std::make_shared<Options>();
  options.add("FROM", o->from, "folder of a plan (telefab-fab plan --out), or a contour file (.tfc)").required();
  options
      .add("--format", o->format,
           "of a plan: goo, sl1, nanodlp (masks and exposures); of either: png (a folder of pictures), 3mf (slices), "
           "cli, cli-binary (Common Layer Interface), svg, jsonl (one JSON line a layer)")
      .required()
      .one_of({"goo", "sl1", "nanodlp", "3mf", "cli", "cli-binary", "svg", "jsonl", "png"});
  options.add_output("--out", o->out, "file, or folder for png").required();
  options
      .add("--although", o->although,
           "NAME of what holds the plan (telefab-fab plan lists it); give every one. A held plan is not exported "
           "without. \"exposures\" holds where the file would make them otherwise than planned")
      .separated_by(',');
  options.flag("--no-supports", o->no_supports, "contours of a plan: the part alone, at its height above the base");
  declare_machine_choice(options, o->machine,
                         "machine whose pixels and platform are used; default: the one it was planned or sliced for",
                         MachineIs::Optional);
  options.footer(
      "Contours of a plan are the part and its supports, as two parts of the file (united in jsonl); of a .tfc file "
      "the\n"
      "part alone.\n"
      "Pictures in goo, sl1 and nanodlp are turned as projection.orientation of the machine says; the file states it.\n"
      "An sl1 file ends in .sl1, .sl1s or .m1, by the printer's model (file.model of the profile). SL1 and NanoDLP "
      "hold\n"
      "two exposures a job: what becomes of the others is shown, and holds the export above file.most_exposure_error.\n"
      "The same input gives the same bytes. A file appears whole or not at all.");
  return [o](std::stop_token stop) -> Result<ExitCode> {
    const auto format = mask_format_of(o->format);
    auto source = open_source(*o, !format && o->format != "png");
    if (!source) return tl::unexpected{source.error()};
    if (format && !source->plan)
      return fail(ErrorCode::InvalidInput,
                  fmt::format("--format {} holds masks and exposures; give the folder of a plan. Make one with: "
                              "telefab-fab plan {} --out DIR",
                              o->format, o->from));
    const auto machine = machine_of(*source, *o);
    if (!machine) return tl::unexpected{machine.error()};
    if (const auto may = may_leave(*source, *machine, *o); !may) {
      if (may.error().code != ErrorCode::NotPermitted) return tl::unexpected{may.error()};
      write_note(fmt::format("telefab-fab: {}\n", may.error().what));
      return ExitCode::NotCertified;
    }
    const auto layers = export_as_asked(*source, *machine, *o, stop);
    clear_progress();
    if (!layers) return tl::unexpected{layers.error()};
    write_output(fmt::format("{} layers written to {}\n", *layers, o->out));
    return ExitCode::Ok;
  };
}

}  // namespace telefab::fab
