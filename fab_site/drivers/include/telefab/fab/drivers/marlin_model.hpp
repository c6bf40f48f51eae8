// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <cstdint>
#include <deque>
#include <optional>
#include <string>
#include <telefab/base/clock.hpp>
#include <telefab/fab/device/machine_log.hpp>
#include <telefab/fab/drivers/line_model.hpp>

namespace telefab::fab {

/// What a Marlin board can do beside moving.
struct MarlinBoard {
  bool reports_temperatures = true;  ///< knows M155; else it says that it does not
  bool has_thermistors = true;       ///< else M105 is answered with an empty line of values
};

/// A Marlin 2 board with one vertical axis and the emergency parser, as bytes on its line: answers every line but empty
/// ones with `ok`, in order; a line that waits for motion holds back all behind it and says busy every two seconds;
/// does not move before homing and stops at its software ends, saying nothing. M410 acts at once. Homing goes up.
/// Facts: general knowledge of Marlin 2.0's gcode pages.
class MarlinModel final : public LineModel {
 public:
  /// `top_mm`: gap between platform and vat at rest after homing. The clock and the log must outlive the model; the
  /// log may be null.
  MarlinModel(double top_mm, const Clock& clock, MachineLog* log, MarlinBoard board = {});

  [[nodiscard]] bool receive(std::string_view bytes) override;
  [[nodiscard]] std::string transmit() override;
  void reopened() override;
  [[nodiscard]] bool present() const override { return true; }

  [[nodiscard]] double gap_mm() const { return gap_mm_; }
  /// From now on; 0, as it starts: speeds are reached at once.
  void set_acceleration(double mm_per_s2) { acceleration_mm_per_s2_ = mm_per_s2; }
  /// What its sensors feel from now on.
  double hotend_celsius = 21, bed_celsius = 25, chamber_celsius = 23;
  /// The thermal runaway guard ends everything: an error line, then silence until reopened.
  void halt();
  /// Swallows the next line: no answer ever.
  void lose_next_line() { lose_line_ = true; }

 private:
  struct Motion {
    Nanoseconds from{}, until{};
    double from_mm = 0, to_mm = 0;
    bool homing = false;
    double mm_per_s = 0;
    Nanoseconds queued{};
  };
  void queue_move(double to_mm, double mm_per_s, bool homing);
  void restart();
  void tick();
  void quick_stop();
  void work();
  /// True when the line is done; false while it waits for motion.
  [[nodiscard]] bool execute(const std::string& line);
  void answer(const std::string& text) { outgoing_ += text + "\n"; }
  [[nodiscard]] std::string temperatures() const;

  double top_mm_;
  const Clock& clock_;
  MachineLog* log_;
  MarlinBoard board_;
  double gap_mm_;
  double acceleration_mm_per_s2_ = 0;
  bool homed_ = false, halted_ = false, lose_line_ = false, waiting_ = false;
  Nanoseconds boot_until_{}, next_report_{}, next_busy_{};
  bool reports_ = false;
  double feed_mm_per_min_ = 0;
  std::string incoming_, outgoing_;
  std::deque<std::string> lines_;
  std::deque<Motion> motions_;
};

}  // namespace telefab::fab
