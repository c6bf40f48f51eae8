// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <chrono>

namespace telefab {

using Nanoseconds = std::chrono::nanoseconds;

/// Time as an argument. Code that waits or stamps takes a Clock.
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

/// A system clock whose seconds are shorter: for simulated machines that run faster than the real ones.
class ScaledClock final : public Clock {
 public:
  /// factor > 0: simulated seconds per real second.
  explicit ScaledClock(double factor) : factor_{factor}, start_{real_.now()} {}
  [[nodiscard]] Nanoseconds now() const override { return start_ + scaled(real_.now() - start_, factor_); }
  /// Real: a record says when it was made.
  [[nodiscard]] Nanoseconds wall() const override { return real_.wall(); }
  void sleep_for(Nanoseconds duration) override { real_.sleep_for(scaled(duration, 1 / factor_)); }

 private:
  [[nodiscard]] static Nanoseconds scaled(Nanoseconds t, double by) {
    return Nanoseconds{static_cast<Nanoseconds::rep>(static_cast<double>(t.count()) * by)};
  }
  SystemClock real_;
  double factor_;
  Nanoseconds start_;
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
