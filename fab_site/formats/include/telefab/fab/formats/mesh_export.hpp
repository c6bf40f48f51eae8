// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <filesystem>
#include <stop_token>
#include <telefab/base/progress.hpp>
#include <telefab/fab/support/structure_mesh.hpp>

namespace telefab::fab {

/// Part and supports as two coloured objects of a 3MF file, millimetres. Same mesh, same bytes; the file appears whole
/// or not at all. Fails: Cancelled, as write_file_atomically.
[[nodiscard]] Result<void> export_threemf(const StructureMesh& mesh, const std::filesystem::path& path,
                                          const ProgressSink& progress, std::stop_token stop);

}  // namespace telefab::fab
