// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <cstdint>
#include <deque>
#include <optional>
#include <string>
#include <telefab/base/clock.hpp>
#include <telefab/fab/device/machine_log.hpp>
#include <telefab/fab/drivers/board_motion.hpp>
#include <telefab/fab/drivers/line_model.hpp>
#include <telefab/fab/drivers/model_lamp.hpp>

namespace telefab::fab {

/// What a Marlin board can do beside moving.
struct MarlinBoard {
  bool reports_temperatures = true;  ///< knows M155; else it says that it does not
  bool has_thermistors = true;       ///< else M105 is answered with an empty line of values
  bool has_emergency_parser = true;  ///< else M410 waits for its turn
  bool restarts_on_open = true;      ///< false: its USB port is its own, opening it is not noticed
  bool is_marlin = true;             ///< else M115 names another firmware
  std::uint32_t fans = 1;            ///< a number beyond is taken and ignored; 0: M106 and M107 are unknown
  bool switches_pins = true;         ///< knows M42
  std::uint32_t protected_pin = 40;  ///< M42 refuses it
  bool queues_fans = false;          ///< LASER_SYNCHRONOUS_M106_M107: switched by the planner, in order
  bool z_sync = false;               ///< NANODLP_Z_SYNC: says so behind each dwell
};

/// Ways a Marlin board can fail. Each strikes at the n-th line after it was planned.
enum class MarlinFault : std::uint8_t {
  Garbled,    ///< the line is carried out as a command that nobody knows
  Swallowed,  ///< the line is lost and never answered
  BrownOut,   ///< its power fails and comes back
  CableLost,  ///< the line is gone until reopened; the board goes on with what it has
};
inline constexpr std::size_t kMarlinFaults = 4;
[[nodiscard]] std::string_view name_of(MarlinFault fault);

/// What is wired to its lamp.
struct MarlinLamp {
  bool is_fan = true;  ///< else a pin
  std::uint32_t number = 0;
};

/// A Marlin 2 board with one vertical axis and a lamp at a fan's or another pin, as bytes on its line: answers every
/// line but empty ones with `ok`, in order; a line that waits for motion or dwells holds back all behind it and says
/// busy every two seconds; lines are carried out at their own times, whoever looks or not. Four wait in its queue and
/// 128 bytes before it; what comes beyond is lost. Does not move before homing and stops at its software ends, saying
/// nothing. M410 acts at once, on motion alone. Homing goes up. Source: Marlin 2.1 (M106_M107.cpp, M42.cpp, G4.cpp,
/// queue.cpp, M115.cpp), read for its facts.
class MarlinModel final : public LineModel {
 public:
  /// `top_mm`: gap between platform and vat at rest after homing. The clock and the log must outlive the model; the
  /// log may be null.
  MarlinModel(double top_mm, const Clock& clock, MachineLog* log, MarlinBoard board = {}, MarlinLamp lamp = {});

  [[nodiscard]] bool receive(std::string_view bytes) override;
  [[nodiscard]] std::string transmit() override;
  void reopened() override;
  [[nodiscard]] bool present() const override { return !is_unplugged_; }

  /// Lets time pass: carries out what is due by now.
  void tick();
  [[nodiscard]] const ModelLamp& lamp() const { return lamp_; }
  void plan_fault(MarlinFault fault, std::uint64_t lines_from_now) { fault_ = {fault, lines_ + lines_from_now}; }
  [[nodiscard]] std::uint64_t lines() const { return lines_; }

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
  struct Line {
    Nanoseconds came{};
    std::string text;
  };
  struct Pending {
    Nanoseconds due{};
    std::string text;
    bool is_busy = false;
  };
  void queue_move(double to_mm, double mm_per_s, bool homing);
  void restart();
  void end_motions(Nanoseconds until);
  void quick_stop();
  void execute(const std::string& line);
  /// False: it is none of these.
  [[nodiscard]] bool move(std::string_view code, const std::string& line);
  [[nodiscard]] bool report(std::string_view code, const std::string& line);
  [[nodiscard]] bool switch_lamp(std::string_view code, const std::string& line);
  void drive_lamp(bool is_fan, std::uint32_t number, double s);
  void wait_until(Nanoseconds until) { busy_until_ = std::max(busy_until_, until); }
  [[nodiscard]] Nanoseconds idle_at() const;
  void answer(const std::string& text) { answer_at(text, at_); }
  void answer_at(const std::string& text, Nanoseconds due);
  [[nodiscard]] std::string temperatures() const;

  double top_mm_;
  const Clock& clock_;
  MachineLog* log_;
  MarlinBoard board_;
  MarlinLamp wiring_;
  ModelLamp lamp_;
  double gap_mm_;
  double acceleration_mm_per_s2_ = 0;
  bool homed_ = false, halted_ = false, lose_line_ = false, is_unplugged_ = false, waits_for_motion_ = false;
  Nanoseconds boot_until_{}, next_report_{}, at_{}, busy_until_{};
  bool reports_ = false;
  double feed_mm_per_min_ = 0;
  std::string incoming_;
  std::size_t buffered_bytes_ = 0;
  std::uint64_t lines_ = 0;
  std::optional<std::pair<MarlinFault, std::uint64_t>> fault_;
  std::deque<Line> lines_in_;
  std::deque<Pending> outgoing_;
  std::deque<BoardMotion> motions_;
};

}  // namespace telefab::fab
