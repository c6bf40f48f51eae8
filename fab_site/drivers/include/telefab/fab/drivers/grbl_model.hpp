// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <cstdint>
#include <deque>
#include <optional>
#include <string>
#include <string_view>
#include <telefab/base/clock.hpp>
#include <telefab/fab/device/machine_log.hpp>
#include <telefab/fab/drivers/board_motion.hpp>
#include <telefab/fab/drivers/line_model.hpp>
#include <telefab/fab/drivers/model_lamp.hpp>

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
  HangUp,      ///< the line is gone until reopened; motion stops, for the board has no power either
  CableLost,   ///< the line is gone until reopened; the board goes on with what it has
};
inline constexpr std::size_t kStageFaults = 9;
[[nodiscard]] std::string_view name_of(StageFault fault);

/// How a GRBL board was built and set up.
struct GrblBoard {
  bool laser_mode = true;          ///< $32
  double full_s = 1000;            ///< $30
  double least_s = 0;              ///< $31
  unsigned status_mask = 3;        ///< $10; 2: the report says how much room its buffers have
  std::size_t buffer_bytes = 128;  ///< of its receive buffer
  bool variable_spindle = true;    ///< built with it
  std::string_view version = "1.1h";
};

/// A GRBL 1.1 board with one vertical axis and a lamp at its spindle pin, as bytes on its line: boots locked, refuses
/// to move before homing, beyond its limits or without a speed. Lines wait in a receive buffer, what comes
/// beyond is lost; they are carried out one after the other, each at its own time, whoever looks or not: a move is
/// answered when it is queued, G4 and the spindle wait until nothing moves, and G4 then dwells ceil(20 P) steps of 50
/// ms. In laser mode M3 lights in G1 only. `!` freezes a dwell, and outside laser mode leaves the lamp on. Homing goes
/// up and ends one millimetre below the switch. Threads: one caller at a time. Source: gnea/grbl 1.1 (gcode.c,
/// motion_control.c, spindle_control.c, protocol.c, report.c), read for its facts.
class GrblModel final : public LineModel {
 public:
  /// `top_mm`: gap between platform and vat at rest after homing. The clock and the log must outlive the model; the
  /// log may be null.
  GrblModel(double top_mm, const Clock& clock, MachineLog* log, GrblBoard board = {});

  [[nodiscard]] bool receive(std::string_view bytes) override;
  [[nodiscard]] std::string transmit() override;
  void reopened() override;
  [[nodiscard]] bool present() const override { return !gone_; }

  void plan_fault(StageFault fault, std::uint64_t lines_from_now);
  /// Lets time pass: carries out what is due by now.
  void tick();
  [[nodiscard]] const ModelLamp& lamp() const { return lamp_; }
  /// Bytes that found no room in the receive buffer.
  [[nodiscard]] std::uint64_t overflows() const { return overflows_; }
  [[nodiscard]] double gap_mm() const { return gap_mm_; }
  /// From now on; 0, as it starts: speeds are reached at once.
  void set_acceleration(double mm_per_s2) { acceleration_mm_per_s2_ = mm_per_s2; }
  [[nodiscard]] std::uint64_t lines() const { return lines_; }

 private:
  struct Pending {
    Nanoseconds due{};
    std::string text;
  };
  struct Line {
    Nanoseconds came{};
    std::string text;
  };
  struct Block;
  void queue_move(double to_mm, double mm_per_s, bool homing);
  void end_motions(Nanoseconds until);
  void restart(Nanoseconds at);
  void lock(std::string_view alarm);
  void stop_motion(Nanoseconds at);
  void freeze();
  void thaw();
  void take_byte(char c);
  void answer(std::string text, Nanoseconds due);
  void execute(std::string_view line);
  void system_command(std::string_view line);
  void carry_out(const Block& block);
  [[nodiscard]] bool move(const Block& block);
  void drive_lamp(Nanoseconds at);
  void acknowledge(Nanoseconds due);
  void status();
  /// When all motion queued by the line being carried out will be over.
  [[nodiscard]] Nanoseconds idle_at() const;

  double top_mm_;
  const Clock& clock_;
  MachineLog* log_;
  GrblBoard board_;
  ModelLamp lamp_;
  double gap_mm_;
  double acceleration_mm_per_s2_ = 0;
  bool locked_ = true;
  bool gone_ = false;
  Nanoseconds boots_until_{};  ///< what arrives before is lost
  std::string incoming_;
  std::deque<Line> lines_in_;
  std::size_t buffered_bytes_ = 0;  ///< of lines that wait and of the one coming in
  std::uint64_t overflows_ = 0;
  Nanoseconds at_{};        ///< of the event being carried out
  Nanoseconds ready_at_{};  ///< for the next line
  std::optional<Nanoseconds> frozen_at_;
  std::deque<Pending> outgoing_;
  std::deque<BoardMotion> motions_;
  double feed_mm_per_min_ = 0;
  double s_ = 0;
  bool spindle_on_ = false;
  bool feeds_ = false;  ///< G1 is modal
  bool report_accessories_ = false;
  std::optional<std::pair<StageFault, std::uint64_t>> fault_;
  std::optional<StageFault> now_;
  std::uint64_t lines_ = 0;
};

}  // namespace telefab::fab
