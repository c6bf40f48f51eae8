// SPDX-License-Identifier: GPL-3.0-or-later
#include <fmt/format.h>

#include <memory>
#include <telefab/command_line/output.hpp>

#include "part_files.hpp"
#include "slice_outputs.hpp"
#include "verbs.hpp"

namespace telefab::scan {
namespace {

struct Options {
  std::vector<std::string> parts;
  SliceOutputChoice outputs;
};

Result<ExitCode> run(const Options& o, std::stop_token stop) {
  auto sources = parts_in(o.parts);
  if (!sources) return tl::unexpected{sources.error()};
  const auto parts = PartSequence::of(std::move(*sources), stop);
  if (!parts) return tl::unexpected{parts.error()};
  if (auto ok = parts->is_whole(); !ok) return tl::unexpected{ok.error()};

  SliceOutputs outputs{o.outputs, parts->codec()};
  const LayerSink sink = [&](const StackHeader& header, Layer&& layer) {
    return outputs.take(header, layer, header.layer_count);
  };
  int shown = -1;
  const auto report = parts->replay(sink, progress_bar(shown), stop);
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

VerbBody declare_merge(VerbOptions& options) {
  auto o = std::make_shared<Options>();
  options.add("PART", o->parts, "parts of one slicing, in any order, or the folder they lie in").required();
  declare_slice_outputs(options, o->outputs);
  options.footer(
      "Parts come from telefab-scan slice --part I/N --parts FOLDER. Together they give the same stack, byte for byte, "
      "certificates and report as one run of slice; the scan is not needed any more. Parts that are missing, damaged, "
      "of another slicing or of another division are refused by name.");
  return [o](std::stop_token stop) { return run(*o, stop); };
}

}  // namespace telefab::scan
