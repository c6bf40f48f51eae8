// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <cstdint>
#include <memory>
#include <string>
#include <string_view>
#include <telefab/base/clock.hpp>
#include <telefab/base/result.hpp>
#include <variant>
#include <vector>

namespace telefab {

using SqlValue = std::variant<std::int64_t, double, std::string>;
/// One row as text, column by column.
using SqlRow = std::vector<std::string>;

inline constexpr ErrorCode kGaveWay = ErrorCode::Cancelled;

/// A database that a fleet's queue is kept in, where the two kinds differ. Statements are what both understand, `?` for
/// each value. Threads: one.
class FleetSql {
 public:
  virtual ~FleetSql() = default;
  FleetSql(const FleetSql&) = delete;
  FleetSql& operator=(const FleetSql&) = delete;

  /// One statement. Conflict: it would break a key. kGaveWay: another transaction was in the way, and this one may be
  /// tried again from its beginning; so may one of which commit() fails so.
  [[nodiscard]] virtual Result<std::vector<SqlRow>> run(const std::string& text, std::vector<SqlValue> values) = 0;
  /// What runs until commit() is on disk as a whole, or not at all.
  [[nodiscard]] virtual Result<void> begin() = 0;
  /// Those who wait() learn of it.
  [[nodiscard]] virtual Result<void> commit() = 0;
  virtual void roll_back() = 0;
  [[nodiscard]] virtual Result<bool> wait(Nanoseconds longest) = 0;

  /// An expression: milliseconds since 1970 by the clock of the queue.
  [[nodiscard]] virtual std::string now() const = 0;
  /// Behind a SELECT of rows of fleet_job as `j`, one of which is about to be changed.
  [[nodiscard]] virtual std::string_view skipping_locked() const = 0;
  /// Until the transaction ends nobody else numbers events or makes tables.
  [[nodiscard]] virtual Result<void> be_alone() = 0;
  /// Type of a column that numbers its rows.
  [[nodiscard]] virtual std::string_view numbered() const = 0;
  /// Of the tables there are; 0: none.
  [[nodiscard]] virtual Result<std::int64_t> version() = 0;
  /// For messages: "the fleet's file fleet.sqlite".
  [[nodiscard]] virtual std::string name() const = 0;

 protected:
  FleetSql() = default;
};

}  // namespace telefab
