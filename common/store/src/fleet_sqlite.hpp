// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <filesystem>

#include "fleet_sql.hpp"

namespace telefab {

/// Fails as open_fleet_file. The clock must outlive it.
[[nodiscard]] Result<std::unique_ptr<FleetSql>> open_fleet_sqlite(const std::filesystem::path& path,
                                                                  const Clock& clock);

}  // namespace telefab
