// SPDX-License-Identifier: GPL-3.0-or-later
#include <fmt/format.h>

#include <filesystem>
#include <memory>
#include <telefab/base/file.hpp>
#include <telefab/command_line/machine_choice.hpp>
#include <telefab/command_line/output.hpp>
#include <telefab/command_line/slice_options.hpp>
#include <telefab/job/readable_scans.hpp>
#include <telefab/scan/slicing/job_parameters.hpp>
#include <telefab/scan/slicing/slice_scan.hpp>

#include "cloud_files.hpp"
#include "slice_outputs.hpp"
#include "verbs.hpp"

namespace telefab::scan {
namespace {

constexpr std::uint64_t kMaxScanBytes = 64ULL << 30U;

struct Options {
  std::string cloud;
  MachineChoice machine;
  SliceOutputChoice outputs;
  SliceParameters asked;
  unsigned threads = 0;
  std::string layers;
};

Result<JobParameters> parameters_from(const Options& o) {
  const auto machine = chosen_machine(o.machine);
  if (!machine) return tl::unexpected{machine.error()};
  auto parameters = job_parameters_of(o.asked, *machine, o.outputs.stack.empty() ? Contours::Plain : Contours::Coded);
  if (!parameters) return parameters;
  parameters->slice.threads = o.threads;
  if (!o.layers.empty()) {
    if (!o.outputs.stack.empty())
      return fail(ErrorCode::InvalidInput, "a .tfc file holds a whole stack: use --contours with --layers");
    const auto layers = layers_from(o.layers);
    if (!layers) return tl::unexpected{layers.error()};
    parameters->slice.layers = *layers;
  }
  if (auto ok = parameters->slice.validate(); !ok) return tl::unexpected{ok.error()};
  return parameters;
}

Result<ExitCode> run(const Options& o, std::stop_token stop) {
  const auto parameters = parameters_from(o);
  if (!parameters) return tl::unexpected{parameters.error()};
  const auto scan = read_file(o.cloud, kMaxScanBytes);
  if (!scan) return tl::unexpected{scan.error()};

  SliceOutputs outputs{o.outputs, parameters->codec};
  const LayerSink sink = [&](const StackHeader& header, Layer&& layer) -> Result<void> {
    const auto range = range_of(parameters->slice, header.layer_count);
    if (!range) return tl::unexpected{range.error()};
    return outputs.take(header, layer, range->end);
  };
  int shown = -1;
  const auto report = slice_scan(*scan, name_of_file(o.cloud), parameters->slice, sink, progress_bar(shown), stop);
  end_progress_bar(shown);
  if (!report) return tl::unexpected{report.error()};

  for (const std::string& warning : report->warnings) write_note(fmt::format("warning: {}\n", warning));
  const std::string json = to_json(*report);
  if (auto ok = outputs.write(json); !ok) return tl::unexpected{ok.error()};
  if (o.outputs.json)
    write_output(fmt::format("{}\n", json));
  else
    print_summary(*report);
  return verdict_of(*report, o.outputs);
}

}  // namespace

VerbBody declare_slice(VerbOptions& options) {
  auto o = std::make_shared<Options>();
  options.add("CLOUD", o->cloud, fmt::format("scan: {}", kReadableScans)).required();
  declare_machine_choice(options, o->machine, "machine profile to slice for", MachineIs::Required);
  declare_slice_outputs(options, o->outputs);
  declare_slice_parameters(options, o->asked);
  options.add("--threads", o->threads, "worker threads; 0: one a core").shows_default();
  options.add("--layers", o->layers, "cut these layers only, FIRST:LAST, counted from 0").read_by(layers_from);
  return [o](std::stop_token stop) { return run(*o, stop); };
}

}  // namespace telefab::scan
