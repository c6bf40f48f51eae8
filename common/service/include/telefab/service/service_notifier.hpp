// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <functional>
#include <optional>
#include <telefab/base/clock.hpp>
#include <telefab/net/loop.hpp>

namespace telefab {

/// What the service manager hears of a daemon (sd_notify(3)): READY=1, WATCHDOG=1 while it is alive, STOPPING=1.
/// Without NOTIFY_SOCKET nothing is said and nothing costs time. Threads: the loop's only.
class ServiceNotifier {
 public:
  /// Says that the daemon is ready and, where the manager watches it (WATCHDOG_USEC), says from the loop three times a
  /// period that it lives, as long as `is_alive` says so: a loop that hangs says nothing, and neither does one whose
  /// other threads hang. The notifier must outlive the loop's run.
  void begin(net::Loop& loop, std::function<bool()> is_alive);
  /// Says that the daemon ends.
  void end();

 private:
  void feed();
  net::Loop* loop_ = nullptr;
  std::function<bool()> is_alive_;
  std::chrono::milliseconds every_{0};
};

/// Judges a thread by a count it raises as long as it goes on. Threads: one caller at a time.
class Heartbeat {
 public:
  /// `longest`: silence beyond this is death.
  explicit Heartbeat(Nanoseconds longest) : longest_{longest} {}
  /// `beats`: the count now; empty: the thread has nothing to do, which is fine for any time.
  [[nodiscard]] bool is_alive(std::optional<std::uint64_t> beats, Nanoseconds now);

 private:
  Nanoseconds longest_;
  std::optional<std::uint64_t> last_;
  Nanoseconds since_{};
};

}  // namespace telefab
