// SPDX-License-Identifier: GPL-3.0-or-later
#include <telefab/base/file.hpp>
#include <telefab/fab/formats/contour_export.hpp>

#include "cli_writer.hpp"
#include "svg_writer.hpp"
#include "threemf_writer.hpp"

namespace telefab::fab {
namespace {

Result<void> write_text(LayerText&& text, const ContourJob& job, const std::filesystem::path& path,
                        const ProgressSink& progress, const std::stop_token& stop) {
  std::string out;
  text.begin(out);
  for (std::uint32_t i = 0; i < job.layer_count; ++i) {
    if (stop.stop_requested()) return fail(ErrorCode::Cancelled, "the export was cancelled; nothing was written");
    text.layer(out, i);
    report(progress, WorkStage::WritingContours, (i + 1.0) / job.layer_count);
  }
  text.end(out);
  return write_file_atomically(path, out);
}

}  // namespace

std::optional<ContourFormat> contour_format_from_name(std::string_view name) {
  if (name == "cli") return ContourFormat::CliAscii;
  if (name == "cli-binary") return ContourFormat::CliBinary;
  if (name == "svg") return ContourFormat::Svg;
  if (name == "3mf") return ContourFormat::ThreeMf;
  return std::nullopt;
}

Result<void> export_contours(ContourFormat format, const ContourJob& job, const std::filesystem::path& path,
                             const ProgressSink& progress, std::stop_token stop) {
  switch (format) {
    case ContourFormat::CliAscii:
      return write_text(CliText{job, false}, job, path, progress, stop);
    case ContourFormat::CliBinary:
      return write_text(CliText{job, true}, job, path, progress, stop);
    case ContourFormat::Svg:
      return write_text(SvgText{job}, job, path, progress, stop);
    case ContourFormat::ThreeMf:
      return write_threemf(job, path, progress, std::move(stop));
  }
  return fail(ErrorCode::Internal, "a contour format without a writer");
}

}  // namespace telefab::fab
