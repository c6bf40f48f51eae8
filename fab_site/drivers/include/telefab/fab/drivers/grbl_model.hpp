// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <cstdint>
#include <deque>
#include <optional>
#include <string>
#include <string_view>
#include <telefab/base/clock.hpp>
#include <telefab/fab/device/machine_log.hpp>
#include <telefab/fab/drivers/line_model.hpp>

namespace telefab::fab {

/// Ways a GRBL board can fail. Each strikes at the n-th line after it was planned.
enum class StageFault : std::uint8_t {
  ErrorLine,   ///< the line is answered error:20
  AlarmLost,   ///< ALARM:1, position lost
  AlarmLimit,  ///< ALARM:2
  Restart,     ///< banner in the middle of it; motion stops, position lost
  LostSteps,   ///< the move ends 0.5 mm short and the board knows
  NoOk,        ///< the line is carried out, its ok never comes
  Garbage,     ///< noise bytes before the answer
  HangUp,      ///< the line is gone until reopened; motion stops
};
inline constexpr std::size_t kStageFaults = 8;
[[nodiscard]] std::string_view name_of(StageFault fault);

/// A GRBL 1.1 board with one vertical axis, as bytes on its line: boots locked, refuses to move before homing, beyond
/// its limits or without a speed, answers `ok` when a line is queued and G4 when everything before it is over. Homing
/// goes up and ends one millimetre below the switch. Threads: one caller at a time.
class GrblModel final : public LineModel {
 public:
  /// `top_mm`: gap between platform and vat at rest after homing. The clock and the log must outlive the model; the
  /// log may be null.
  GrblModel(double top_mm, const Clock& clock, MachineLog* log);

  [[nodiscard]] bool receive(std::string_view bytes) override;
  [[nodiscard]] std::string transmit() override;
  void reopened() override;
  [[nodiscard]] bool present() const override { return !gone_; }

  void plan_fault(StageFault fault, std::uint64_t lines_from_now);
  void tick();
  [[nodiscard]] double gap_mm() const { return gap_mm_; }
  /// From now on; 0, as it starts: speeds are reached at once.
  void set_acceleration(double mm_per_s2) { acceleration_mm_per_s2_ = mm_per_s2; }
  [[nodiscard]] std::uint64_t lines() const { return lines_; }

 private:
  struct Pending {
    Nanoseconds due{};
    std::string text;
  };
  struct Motion {
    Nanoseconds from{}, until{};
    double from_mm = 0, to_mm = 0;
    bool homing = false;
    double mm_per_s = 0;
    Nanoseconds queued{};
  };
  void queue_move(double to_mm, double mm_per_s, bool homing);
  void restart();
  void stop_motion();
  void answer(std::string text, Nanoseconds due);
  void execute(std::string_view line);
  void status();
  [[nodiscard]] Nanoseconds idle_at() const;

  double top_mm_;
  const Clock& clock_;
  MachineLog* log_;
  double gap_mm_;
  double acceleration_mm_per_s2_ = 0;
  bool locked_ = true;
  bool gone_ = false;
  Nanoseconds boots_until_{};  ///< what arrives before is lost
  std::string incoming_;
  std::deque<Pending> outgoing_;
  std::deque<Motion> motions_;
  double feed_mm_per_min_ = 0;
  std::optional<std::pair<StageFault, std::uint64_t>> fault_;
  std::optional<StageFault> now_;
  std::uint64_t lines_ = 0;
};

}  // namespace telefab::fab
