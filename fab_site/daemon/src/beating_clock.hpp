// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <atomic>
#include <cstdint>
#include <telefab/base/clock.hpp>

namespace telefab::fab {

/// A clock whose waits are counted.
class BeatingClock final : public Clock {
 public:
  BeatingClock(Clock& inner, std::atomic<std::uint64_t>& beats) : inner_{inner}, beats_{beats} {}
  Nanoseconds now() const override { return inner_.now(); }
  Nanoseconds wall() const override { return inner_.wall(); }
  void sleep_for(Nanoseconds duration) override {
    ++beats_;
    inner_.sleep_for(duration);
  }

 private:
  Clock& inner_;
  std::atomic<std::uint64_t>& beats_;
};

}  // namespace telefab::fab
