// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <limits>
#include <telefab/fleet/fleet.hpp>

#include "fleet_sql.hpp"

// Machines and jobs of a fleet as rows of its tables.
namespace telefab {

/// Deadline of what has none: it sorts last.
constexpr std::int64_t kNever = std::numeric_limits<std::int64_t>::max();

constexpr const char* kMachineColumns =
    "name, fab, profile, light, resin, width_mm, depth_mm, height_mm, pixel_mm, calibrated_unix_ms, readiness, "
    "is_draining, seen_unix_ms";
constexpr const char* kJobColumns =
    "f.id, f.name, f.owner, f.site, f.asks_for, f.light, f.resin, f.width_mm, f.depth_mm, f.height_mm, f.pixel_mm, "
    "f.calibrated_within_ms, f.priority, f.deadline_unix_ms, f.stack_key, f.place, f.state, f.attempt, f.machine, "
    "f.message, COALESCE(l.until_unix_ms, 0)";

/// Reads a row column by column.
class Columns {
 public:
  explicit Columns(const SqlRow& row) : row_{row} {}
  std::string text() { return row_.at(next_++); }
  std::int64_t number() { return std::stoll(row_.at(next_++)); }
  double real() { return std::stod(row_.at(next_++)); }

 private:
  const SqlRow& row_;
  std::size_t next_ = 0;
};

/// Of kMachineColumns.
[[nodiscard]] fleet::Machine machine_of(const SqlRow& row);
/// Of kJobColumns.
[[nodiscard]] fleet::Job job_of(const SqlRow& row);

}  // namespace telefab
