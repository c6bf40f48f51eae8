// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <memory>
#include <optional>
#include <telefab/fab/device/z_stage.hpp>
#include <telefab/fab/usb/line_transport.hpp>
#include <telefab/machine/machine_words.hpp>

namespace telefab::fab {

enum class StageDialect : std::uint8_t { Grbl, Marlin };

/// The value of a sensor in a Marlin temperature report, as M105 and M155 give it; empty where it is not in it.
[[nodiscard]] std::optional<double> celsius_in(std::string_view report, Thermometer thermometer);

struct SerialStageOptions {
  StageDialect dialect = StageDialect::Grbl;
  double top_mm = 0;  ///< gap between platform and vat where homing ends; also the upper soft limit
  double fastest_mm_per_s = 10;
  double homing_mm_per_s = 2;                   ///< slowest part of the board's homing, for the deadline
  double acceleration_mm_per_s2 = 0;            ///< of the board, for deadlines; 0: speeds are reached at once
  Thermometer thermometer = Thermometer::None;  ///< Marlin only
};

/// A Z axis behind a serial line that speaks GRBL 1.1 or Marlin. Every move ends with a confirmed rest: the board's
/// planner is empty and the position it reports is the one that was ordered. A restart banner or an alarm makes the
/// position unknown, and nothing moves again before home(). Homing must be set up on the board to go up.
class SerialStage final : public ZStage {
 public:
  /// Resets the board and waits for its banner. Fails: DeviceLost, DeviceTimeout (no banner), ProtocolBroken.
  [[nodiscard]] static Result<std::unique_ptr<SerialStage>> open(std::unique_ptr<LineTransport> line,
                                                                 const SerialStageOptions& options, Clock& clock);
  ~SerialStage() override;

  [[nodiscard]] const StageFacts& facts() const override { return facts_; }
  [[nodiscard]] Result<void> home() override;
  /// Both legs of a path are in the board's planner before it comes to rest between them.
  [[nodiscard]] Result<void> move_along(std::span<const StageLeg> legs) override;
  /// InvalidInput: no such board tips a vat.
  [[nodiscard]] Result<void> tilt(Nanoseconds duration) override;
  [[nodiscard]] Result<StageStatus> poll() override;
  [[nodiscard]] Result<void> hold() override;

  /// The last reading of the resin's thermometer, asked for by itself; empty before the first. Cheap: may be called at
  /// every turn of a loop. Fails with DeviceTimeout when the board at rest says nothing of it for five seconds, for
  /// want of such a sensor perhaps, and as poll() when the board restarted or halted.
  [[nodiscard]] Result<std::optional<double>> celsius();

 private:
  enum class Doing : std::uint8_t { Nothing, Homing, Moving, AskingHome, AskingRest };
  SerialStage(std::unique_ptr<LineTransport> line, const SerialStageOptions& options, Clock& clock)
      : line_{std::move(line)}, options_{options}, clock_{clock} {}
  [[nodiscard]] Result<void> connect();
  /// No banner of an earlier restart is still to come, and no answer; DeviceTimeout, DeviceRefused.
  [[nodiscard]] Result<void> synchronise_grbl(Nanoseconds until);
  /// No answer to anything said before is still to come; DeviceTimeout.
  [[nodiscard]] Result<void> synchronise_marlin(Nanoseconds until);
  /// The next line, or nothing until then; DeviceTimeout.
  [[nodiscard]] Result<std::string> next_line(Nanoseconds until);
  void note_temperature(std::string_view line);
  [[nodiscard]] Result<void> send(std::string_view text);
  /// What the board has said by now.
  [[nodiscard]] Result<void> take_lines();
  [[nodiscard]] Result<void> take(const std::string& line);
  [[nodiscard]] Result<void> take_ok();
  [[nodiscard]] Result<void> take_position(double reported_mm);
  [[nodiscard]] tl::unexpected<Error> lost(ErrorCode code, std::string what);

  std::unique_ptr<LineTransport> line_;
  SerialStageOptions options_;
  Clock& clock_;
  StageFacts facts_;
  Doing doing_ = Doing::Nothing;
  bool homed_ = false;
  bool connected_ = false;
  int oks_wanted_ = 0;
  std::uint32_t probes_ = 0;
  int idle_oks_ = 0;  ///< of questions asked at rest; they come before any other
  std::optional<double> celsius_;
  Nanoseconds celsius_at_{};
  std::optional<Nanoseconds> asked_celsius_at_;
  double z_mm_ = 0;
  double target_mm_ = 0;
  double board_top_mm_ = 0;  ///< what the board calls the place where homing ends
  Nanoseconds deadline_{};
};

}  // namespace telefab::fab
