// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <deque>
#include <optional>
#include <string>
#include <telefab/base/clock.hpp>
#include <telefab/job/job.hpp>
#include <vector>

namespace telefab::client {

/// What was seen of a job since the watch began: enough to say how long it may still take. Values only, no terminal.
class WatchHistory {
 public:
  /// `now`: of one monotonic clock; `time_of_day`: "12:03:04", for the list of changes.
  void saw(const Job& job, Nanoseconds now, const std::string& time_of_day);
  [[nodiscard]] const std::optional<Job>& job() const { return job_; }
  /// Changes of state or message, oldest first, at most 200.
  [[nodiscard]] const std::deque<std::string>& changes() const { return changes_; }
  /// Of the present state, by the pace seen while it was watched; empty where there is none yet.
  [[nodiscard]] std::optional<double> seconds_left() const;

 private:
  std::optional<Job> job_;
  std::deque<std::string> changes_;
  std::uint32_t first_done_ = 0;  ///< layers done when the present state was first seen to move
  Nanoseconds first_{};
  Nanoseconds last_{};
};

/// The lines of the full-screen view, exactly `rows` of them, none longer than `columns`. Bytes that would move a
/// terminal's cursor are shown as '?'.
[[nodiscard]] std::vector<std::string> watch_screen(const WatchHistory& history, int columns, int rows);

/// What must be written to make a terminal that shows `before` show `after`: changed lines only, the cursor is left
/// where it is not seen. Empty where nothing changed.
[[nodiscard]] std::string screen_update(const std::vector<std::string>& before, const std::vector<std::string>& after);

}  // namespace telefab::client
