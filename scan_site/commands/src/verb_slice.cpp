// SPDX-License-Identifier: GPL-3.0-or-later
#include <fmt/format.h>

#include <filesystem>
#include <memory>
#include <telefab/command_line/machine_choice.hpp>
#include <telefab/command_line/output.hpp>
#include <telefab/command_line/slice_options.hpp>
#include <telefab/job/readable_scans.hpp>
#include <telefab/scan/slicing/slice_part.hpp>

#include "cloud_files.hpp"
#include "part_files.hpp"
#include "scan_bytes.hpp"
#include "slice_outputs.hpp"
#include "verbs.hpp"

namespace telefab::scan {
namespace {

constexpr int kMostSamples = 1'000'000'000;

struct Options {
  std::string cloud;
  MachineChoice machine;
  SliceOutputChoice outputs;
  SliceParameters asked;
  unsigned threads = 0;
  std::uint64_t samples = *IntakeOptions{}.most_points;
  std::string layers, share, parts;
};

Result<JobParameters> parameters_from(const Options& o) {
  const auto machine = chosen_machine(o.machine);
  if (!machine) return tl::unexpected{machine.error()};
  const bool is_plain = o.outputs.stack.empty() && o.parts.empty();
  auto parameters = job_parameters_of(o.asked, *machine, is_plain ? Contours::Plain : Contours::Coded);
  if (!parameters) return parameters;
  parameters->slice.threads = o.threads;
  parameters->slice.intake.most_points = o.samples > 0 ? std::optional{o.samples} : std::nullopt;
  if (!o.outputs.stack.empty() && (!o.layers.empty() || !o.share.empty() || !o.parts.empty()))
    return fail(ErrorCode::InvalidInput,
                "a .tfc file holds a whole stack: with --layers, --part and --parts leave out --out; telefab-scan "
                "merge makes it of parts, and --contours takes some layers");
  if (!o.share.empty()) {
    const auto share = layer_share_from(o.share);
    if (!share) return tl::unexpected{share.error()};
    parameters->slice.share = *share;
  }
  if (!o.layers.empty()) {
    const auto layers = layers_from(o.layers);
    if (!layers) return tl::unexpected{layers.error()};
    parameters->slice.layers = *layers;
  }
  if (auto ok = parameters->slice.validate(); !ok) return tl::unexpected{ok.error()};
  return parameters;
}

/// What was cut, and the part it became.
struct Cut {
  SliceReport report;
  std::optional<PartPlace> part;
};

Result<ExitCode> conclude(const Options& o, const Cut& cut, SliceOutputs& outputs) {
  for (const std::string& warning : cut.report.warnings) write_note(fmt::format("warning: {}\n", warning));
  const std::string json = cut.part ? json_with(*cut.part, cut.report) : to_json(cut.report);
  if (auto ok = outputs.write(json); !ok) return tl::unexpected{ok.error()};
  if (o.outputs.json) {
    write_output(fmt::format("{}\n", json));
  } else {
    print_summary(cut.report);
    if (cut.part) write_output(fmt::format("{}\n", sentence_of(*cut.part)));
  }
  return verdict_of(cut.report, o.outputs);
}

Result<ExitCode> run(const Options& o, std::stop_token stop) {
  auto parameters = parameters_from(o);
  if (!parameters) return tl::unexpected{parameters.error()};
  const auto scan = ScanBytes::of(o.cloud);
  if (!scan) return tl::unexpected{scan.error()};
  parameters->slice.intake.let_go = [&scan] { scan->let_go(); };

  SliceOutputs outputs{o.outputs, parameters->codec};
  const LayerSink sink = [&](const StackHeader& header, Layer&& layer) -> Result<void> {
    const auto range = range_of(parameters->slice, header.layer_count);
    if (!range) return tl::unexpected{range.error()};
    return outputs.take(header, layer, range->end);
  };
  const std::string name = name_of_file(o.cloud);
  int shown = -1;
  const ProgressSink progress = progress_bar(shown);
  Result<Cut> cut = [&]() -> Result<Cut> {
    if (o.parts.empty()) {
      auto report = slice_scan(scan->bytes(), name, parameters->slice, sink, progress, stop);
      if (!report) return tl::unexpected{report.error()};
      if (auto ok = scan->is_unchanged(); !ok) return tl::unexpected{ok.error()};
      return Cut{std::move(*report), std::nullopt};
    }
    PartPlace place{.key = {digest_of_slicing(scan->digest(), name, o.asked, parameters->slice),
                            parameters->slice.layers, parameters->slice.share}};
    place.file = std::filesystem::path{o.parts} / file_name_of(place.key);
    auto found = replayed_if_there(place, sink, progress, stop);
    if (!found) return tl::unexpected{found.error()};
    if (*found) return Cut{std::move(**found), place};
    auto made = cut_part(scan->bytes(), name, *parameters, place.key.slicing, sink, progress, stop);
    if (!made) return tl::unexpected{made.error()};
    if (auto ok = scan->is_unchanged(); !ok) return tl::unexpected{ok.error()};
    if (auto ok = put_part(place, made->bytes); !ok) return tl::unexpected{ok.error()};
    return Cut{std::move(made->report), place};
  }();
  end_progress_bar(shown);
  if (!cut) return tl::unexpected{cut.error()};
  return conclude(o, *cut, outputs);
}

}  // namespace

VerbBody declare_slice(VerbOptions& options) {
  auto o = std::make_shared<Options>();
  options.add("CLOUD", o->cloud, fmt::format("scan: {}", kReadableScans)).required();
  declare_machine_choice(options, o->machine, "machine profile to slice for", MachineIs::Required);
  declare_slice_outputs(options, o->outputs);
  declare_slice_parameters(options, o->asked, {}, check_text);
  options.add("--threads", o->threads, "worker threads; 0: one a core").shows_default();
  options
      .add(
          "--samples", o->samples,
          "take so many points at most of a scan that has twice as many or more, as even as they come; each stands for "
          "those about it, and memory and time follow this number. 0: all of any scan")
      .within(0, kMostSamples)
      .shows_default();
  options.add("--layers", o->layers, "cut these layers only, FIRST:LAST, counted from 0").read_by(layers_from);
  options
      .add("--part", o->share,
           "cut this share of the layers only, I/N: the I-th of N that are as equal as they can be. Give every worker "
           "another I")
      .read_by(layer_share_from);
  options.add(
      "--parts", o->parts,
      "write what is cut into this folder, as a part that telefab-scan merge puts together with the others. Its "
      "name tells the scan, what is asked for and which layers: where it lies there, nothing is cut again");
  return [o](std::stop_token stop) { return run(*o, stop); };
}

}  // namespace telefab::scan
