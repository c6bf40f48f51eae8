// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <filesystem>
#include <telefab/base/result.hpp>

namespace telefab {

/// Writes the seeds of a program's fuzz targets below `corpus`, each into the folder of its target; seeds_main.cpp
/// calls it. Fails as write_file_atomically.
[[nodiscard]] Result<void> write_seeds(const std::filesystem::path& corpus);

}  // namespace telefab
