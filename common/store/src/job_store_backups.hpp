// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <filesystem>

namespace telefab {

/// Name of a copy of a store: 1 is the newest; 0 is one that is being made.
[[nodiscard]] std::filesystem::path backup_of(const std::filesystem::path& store, int number);

}  // namespace telefab
