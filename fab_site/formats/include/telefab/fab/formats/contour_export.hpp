// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <filesystem>
#include <optional>
#include <stop_token>
#include <telefab/base/progress.hpp>
#include <telefab/fab/formats/contour_job.hpp>

namespace telefab::fab {

/// Files of contours that other programs read. Coordinates are millimetres of the build frame.
enum class ContourFormat : std::uint8_t {
  CliAscii,   ///< Common Layer Interface 2.00, text; nanometres
  CliBinary,  ///< the same, binary, "long" commands; single precision
  Svg,        ///< one group a layer with slic3r:z; y points down, nanometres
  ThreeMf,    ///< 3MF with slice extension, a box as mesh of low resolution; single precision
};

/// "cli", "cli-binary", "svg", "3mf"; nothing for other words.
[[nodiscard]] std::optional<ContourFormat> contour_format_from_name(std::string_view name);

/// Writes a job. Same job, same bytes; the file appears whole or not at all.
/// Fails: Cancelled, as write_file_atomically.
[[nodiscard]] Result<void> export_contours(ContourFormat format, const ContourJob& job,
                                           const std::filesystem::path& path, const ProgressSink& progress,
                                           std::stop_token stop);

}  // namespace telefab::fab
