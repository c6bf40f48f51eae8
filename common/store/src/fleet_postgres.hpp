// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include "fleet_sql.hpp"

namespace telefab {

/// Fails as open_fleet_database, but for the tables.
[[nodiscard]] Result<std::unique_ptr<FleetSql>> open_fleet_postgres(const std::string& uri);

}  // namespace telefab
