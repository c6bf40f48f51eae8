// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <memory>
#include <optional>
#include <telefab/fab/device/stage_light.hpp>
#include <telefab/fab/device/z_stage.hpp>
#include <telefab/fab/usb/line_transport.hpp>
#include <telefab/machine/machine_words.hpp>

namespace telefab::fab {

enum class StageDialect : std::uint8_t { Grbl, Marlin };

/// The value of a sensor in a Marlin temperature report, as M105 and M155 give it; empty where it is not in it.
[[nodiscard]] std::optional<double> celsius_in(std::string_view report, Thermometer thermometer);

/// The light at a board's pin.
struct BoardLight {
  LightCommand command = LightCommand::Spindle;
  std::uint32_t number = 0;  ///< of the fan or the pin
  double power = 1;          ///< (0, 1]; of full PWM; nothing above it is ever sent
  std::uint32_t steps = 1;
  std::uint32_t packet_bytes = 32;  ///< what its adapter carries whole
};

/// One exposure as lines for a board: a dwell, the light, a dwell, dark; dark twice where that fits.
struct LightGroup {
  std::string text;
  int lines = 0;
  std::size_t behind_lead_bytes = 0;  ///< what the board must hold while the first line dwells
};

/// `full_word`: the board's word for full PWM, 255 of Marlin, $30 of GRBL. InvalidInput where the board cannot make the
/// exposure, or not in one packet; says what to change.
[[nodiscard]] Result<LightGroup> light_group(StageDialect dialect, const BoardLight& light, double full_word,
                                             const LightOrder& order);

struct SerialStageOptions {
  StageDialect dialect = StageDialect::Grbl;
  double top_mm = 0;  ///< gap between platform and vat where homing ends; also the upper soft limit
  double fastest_mm_per_s = 10;
  double homing_mm_per_s = 2;                   ///< slowest part of the board's homing, for the deadline
  double acceleration_mm_per_s2 = 0;            ///< of the board, for deadlines; 0: speeds are reached at once
  Thermometer thermometer = Thermometer::None;  ///< Marlin only
  std::optional<BoardLight> light;              ///< that the board switches; empty: none
};

/// A Z axis behind a serial line that speaks GRBL 1.1 or Marlin. Every move ends with a confirmed rest: the board's
/// planner is empty and the position it reports is the one that was ordered. A restart banner or an alarm makes the
/// position unknown, and nothing moves again before home(). Homing must be set up on the board to go up.
/// Where the options name a light, the board is also asked whether it is built and set up so that it times the light
/// and that a restart darkens it (decision 0811).
class SerialStage final : public ZStage, public StageLight {
 public:
  /// Resets the board and waits for its banner; its light is off then. Fails: DeviceLost, DeviceTimeout (no banner),
  /// ProtocolBroken, DeviceRefused (a board that must not switch the light; says what to set).
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

  [[nodiscard]] const StageLightFacts& light_facts() const override { return light_facts_; }
  [[nodiscard]] Result<void> check_light(const LightOrder& order) const override;
  [[nodiscard]] Result<void> light(const LightOrder& order) override;
  [[nodiscard]] Result<StageLightStatus> poll_light() override;
  [[nodiscard]] Result<void> unlight() override;

  /// The last reading of the resin's thermometer, asked for by itself; empty before the first. Cheap: may be called at
  /// every turn of a loop. Fails with DeviceTimeout when the board at rest says nothing of it for five seconds, for
  /// want of such a sensor perhaps, and as poll() when the board restarted or halted.
  [[nodiscard]] Result<std::optional<double>> celsius();

 private:
  enum class Doing : std::uint8_t { Nothing, Homing, Moving, AskingHome, AskingRest, Lighting, AskingDark };
  SerialStage(std::unique_ptr<LineTransport> line, const SerialStageOptions& options, Clock& clock)
      : line_{std::move(line)}, options_{options}, clock_{clock} {}
  [[nodiscard]] Result<void> connect();
  /// No banner of an earlier restart is still to come, and no answer; DeviceTimeout, DeviceRefused.
  [[nodiscard]] Result<void> synchronise_grbl(Nanoseconds until);
  /// No answer to anything said before is still to come; DeviceTimeout.
  [[nodiscard]] Result<void> synchronise_marlin(Nanoseconds until);
  /// The next line, or nothing until then; DeviceTimeout.
  [[nodiscard]] Result<std::string> next_line(Nanoseconds until);
  /// The board may switch the light, as far as it can be asked.
  [[nodiscard]] Result<void> check_board();
  [[nodiscard]] Result<void> check_grbl(Nanoseconds until);
  [[nodiscard]] Result<void> check_marlin(Nanoseconds until);
  /// All lines of an answer up to its ok.
  [[nodiscard]] Result<std::string> answer_to(std::string_view question, Nanoseconds until);
  /// The board holds all of a group whose lead it dwells through; else it is restarted.
  [[nodiscard]] Result<void> check_received(const LightGroup& group);
  /// The last line of a group was answered.
  [[nodiscard]] Result<void> take_dark_ok();
  [[nodiscard]] Result<void> take_light_line(const std::string& line);
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

  std::string banner_;  ///< of the last restart
  StageLightFacts light_facts_;
  double full_word_ = 255;
  std::size_t buffer_bytes_ = 0;  ///< of a GRBL board's receive buffer
  bool light_unsure_ = false;     ///< from the first byte of an exposure to the board's word that it is dark
  Nanoseconds lit_from_{}, lit_until_{};
  int dark_questions_ = 0;
  std::optional<std::size_t> room_bytes_;  ///< of the receive buffer, in the last report
};

}  // namespace telefab::fab
