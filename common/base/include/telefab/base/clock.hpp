#pragma once
#include <chrono>

namespace telefab {

using Nanoseconds = std::chrono::nanoseconds;

/// Time as an argument (STYLE P18). Code that waits or stamps takes a Clock.
/// Threads: all methods may be called from several threads.
class Clock {
 public:
  virtual ~Clock() = default;
  Clock(const Clock&) = delete;
  Clock& operator=(const Clock&) = delete;

  /// Monotonic; only differences mean something.
  [[nodiscard]] virtual Nanoseconds now() const = 0;
  /// Since 1970-01-01T00:00:00Z; for records, never for intervals.
  [[nodiscard]] virtual Nanoseconds wall() const = 0;
  virtual void sleep_for(Nanoseconds duration) = 0;

 protected:
  Clock() = default;
};

/// The machine's clocks. The only code that calls std::chrono's now() and sleeps.
class SystemClock final : public Clock {
 public:
  [[nodiscard]] Nanoseconds now() const override;
  [[nodiscard]] Nanoseconds wall() const override;
  void sleep_for(Nanoseconds duration) override;
};

/// Time that passes only when someone sleeps or advances it; sleep_for returns at once.
class VirtualClock final : public Clock {
 public:
  explicit VirtualClock(Nanoseconds start = {}) : now_{start} {}
  [[nodiscard]] Nanoseconds now() const override { return now_; }
  [[nodiscard]] Nanoseconds wall() const override { return now_; }
  void sleep_for(Nanoseconds duration) override { advance(duration); }
  void advance(Nanoseconds duration) { now_ += duration; }

 private:
  Nanoseconds now_;
};

}  // namespace telefab
