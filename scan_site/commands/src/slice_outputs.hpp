// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <memory>
#include <string>
#include <telefab/base/exit_code.hpp>
#include <telefab/base/progress.hpp>
#include <telefab/codec/stack_codec.hpp>
#include <telefab/command_line/options.hpp>
#include <telefab/scan/slicing/slice_scan.hpp>

namespace telefab::scan {

/// What verbs that have layers to give, make of them.
struct SliceOutputChoice {
  std::string stack, contours, report, preview, points;  ///< paths; empty: not wanted
  bool require_certified = false;
  bool json = false;
};
/// --out, --preview, --contours, --points, --report, --require-certified and --json. `choice` must outlive the parsing.
void declare_slice_outputs(VerbOptions& options, SliceOutputChoice& choice);

/// The files asked for; all of them are written after the last layer, each whole or not at all.
class SliceOutputs {
 public:
  /// `choice` outlives them.
  SliceOutputs(const SliceOutputChoice& choice, const CodecOptions& codec);
  ~SliceOutputs();
  /// Layers in order, as of LayerSink. `end`: behind the last that will come.
  [[nodiscard]] Result<void> take(const StackHeader& header, const Layer& layer, std::uint32_t end);
  /// Writes the files. Fails as the encoder and write_file_atomically do.
  [[nodiscard]] Result<void> write(const std::string& report);

 private:
  struct Begun;
  const SliceOutputChoice& choice_;
  CodecOptions codec_;
  std::unique_ptr<Begun> begun_;
};

/// A bar on the terminal; nothing elsewhere. `shown` is the percentage it stands at and must outlive the sink.
[[nodiscard]] ProgressSink progress_bar(int& shown);
/// Takes the bar away.
void end_progress_bar(int shown);

/// What came of the layers, for people.
void print_summary(const SliceReport& report);
/// Whether --require-certified makes the command fail.
[[nodiscard]] ExitCode verdict_of(const SliceReport& report, const SliceOutputChoice& choice);

}  // namespace telefab::scan
