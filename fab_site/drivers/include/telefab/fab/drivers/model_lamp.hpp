// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <telefab/base/clock.hpp>
#include <telefab/fab/device/machine_log.hpp>

namespace telefab::fab {

/// The lamp on a pin of a board model, and the recorder beside it. Times are those of the board's events, which may lie
/// before Clock::now() of whoever asks it.
class ModelLamp {
 public:
  /// The log may be null and must outlive the lamp.
  explicit ModelLamp(MachineLog* log) : log_{log} {}

  /// So bright, as share of the pin's full power, from then on.
  void set(double share, Nanoseconds at);
  [[nodiscard]] double share() const { return share_; }
  [[nodiscard]] bool lit() const { return share_ > 0; }
  /// All time it was lit, up to then.
  [[nodiscard]] Nanoseconds lit_for(Nanoseconds now) const { return sum_ + (lit() ? now - from_ : Nanoseconds{}); }

 private:
  MachineLog* log_;
  double share_ = 0;
  Nanoseconds from_{}, sum_{};
};

}  // namespace telefab::fab
