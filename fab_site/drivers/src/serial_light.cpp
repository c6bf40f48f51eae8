// SPDX-License-Identifier: GPL-3.0-or-later
#include <fmt/format.h>

#include <algorithm>
#include <charconv>
#include <cmath>
#include <telefab/fab/drivers/grbl_stage.hpp>

// The light at a board's pin. What each firmware makes of these lines: decision 0811.
namespace telefab::fab {

using namespace std::chrono_literals;

namespace {

constexpr Milliseconds kWriteTimeout{100};
constexpr Nanoseconds kWait = 2ms;
constexpr Nanoseconds kCheckTimeout = 3s;
constexpr Nanoseconds kEarly = 20ms;           ///< a board that is done so much too soon has cut the light short
constexpr Nanoseconds kLate = 1s;              ///< and one so much too late does not answer
constexpr Nanoseconds kRestartReaches = 50ms;  ///< a board, from the order on
constexpr int kDarkQuestions = 3;
constexpr Microseconds kGrblStep{50'000}, kMarlinStep{1'000};
constexpr Microseconds kGrblLead{200'000}, kMarlinLead{300'000};
constexpr Microseconds kLongest{600'000'000};
constexpr double kMarlinFull = 255;

Microseconds step_of(StageDialect dialect) { return dialect == StageDialect::Grbl ? kGrblStep : kMarlinStep; }
Microseconds lead_of(StageDialect dialect) { return dialect == StageDialect::Grbl ? kGrblLead : kMarlinLead; }

/// The P of a dwell of GRBL: a hundredth below a whole number of its steps, for it counts them upwards in single
/// precision, and one a hair above would be a step more.
std::string grbl_dwell(Microseconds duration) {
  const auto hundredths = duration.count() / 10'000 - 1;
  const auto whole = hundredths / 100, rest = hundredths % 100;
  return whole > 0 ? fmt::format("{}.{:02}", whole, rest) : fmt::format(".{:02}", rest);
}

/// The number of a setting "$32=1" in GRBL's list.
std::optional<double> setting(std::string_view list, std::string_view name) {
  const std::string mark = fmt::format("{}=", name);
  const std::size_t at = list.find(mark);
  if (at == std::string_view::npos || (at > 0 && list[at - 1] != '\n')) return std::nullopt;
  double value = 0;
  const auto [end, error] = std::from_chars(list.data() + at + mark.size(), list.data() + list.size(), value);
  return error == std::errc{} ? std::optional{value} : std::nullopt;
}

/// A field of a status report of GRBL, as "Bf:15,120": what stands behind its mark.
std::optional<std::string_view> field(std::string_view report, std::string_view mark) {
  const std::size_t at = report.find(mark);
  if (at == std::string_view::npos) return std::nullopt;
  const std::string_view rest = report.substr(at + mark.size());
  return rest.substr(0, rest.find_first_of("|>"));
}

std::optional<std::size_t> room_in(std::string_view report) {
  const auto buffers = field(report, "|Bf:");
  if (!buffers) return std::nullopt;
  const std::size_t comma = buffers->find(',');
  std::size_t room = 0;
  if (comma == std::string_view::npos ||
      std::from_chars(buffers->data() + comma + 1, buffers->data() + buffers->size(), room).ec != std::errc{})
    return std::nullopt;
  return room;
}

tl::unexpected<Error> unfit(std::string_view what) {
  return fail(ErrorCode::DeviceRefused, fmt::format("stage: it must not switch the light: {}", what));
}

}  // namespace

Result<LightGroup> light_group(StageDialect dialect, const BoardLight& light, double full_word,
                               const LightOrder& order) {
  const Microseconds step = step_of(dialect);
  if (order.duration < step || order.duration > kLongest || order.duration % step != 0us)
    return fail(
        ErrorCode::InvalidInput,
        fmt::format("an exposure of {} us cannot be timed by this stage's board; it makes multiples of {} ms up "
                    "to {} s. Correct layers.exposure_s or bottom_exposure_s",
                    order.duration.count(), step.count() / 1000, kLongest.count() / 1'000'000));
  const auto dimmed = light_step(order.share, light.steps);
  if (!dimmed) return tl::unexpected{dimmed.error()};
  const auto word = static_cast<long>(std::floor(full_word * light.power * *dimmed / light.steps));
  if (word < 1 || word > 9999)
    return fail(ErrorCode::InvalidInput,
                fmt::format("a light of {} is not a word of this board; correct light.power or its $30", word));
  LightGroup group;
  std::string lead, dark;
  if (dialect == StageDialect::Grbl) {
    lead = fmt::format("G4P{}\n", grbl_dwell(kGrblLead));
    group.text = fmt::format("G1F1M3S{}G4P{}\n", word, grbl_dwell(order.duration));
    dark = "M5\n";
    group.lines = 3;
  } else {
    const bool is_fan = light.command == LightCommand::Fan;
    const std::string number = is_fan && light.number == 0 ? std::string{} : fmt::format("P{}", light.number);
    // A fan without a word runs fully; each byte counts.
    const std::string power = is_fan && word == std::lround(kMarlinFull) ? std::string{} : fmt::format("S{}", word);
    lead = fmt::format("G4P{}\n", kMarlinLead.count() / 1000);
    group.text = fmt::format("{}{}{}\nG4P{}\n", is_fan ? "M106" : "M42", number, power, order.duration.count() / 1000);
    dark = is_fan ? fmt::format("M107{}\n", number) : fmt::format("M42{}S0\n", number);
    group.lines = 4;
  }
  group.text = lead + group.text + dark;
  if (group.text.size() > light.packet_bytes)
    return fail(
        ErrorCode::InvalidInput,
        fmt::format("the {} bytes of an exposure of {} us do not go through its adapter at once; where it is not a "
                    "CH340 state light.packet_bytes = 64",
                    group.text.size(), order.duration.count()));
  // Once more, where there is room: one garbled line then leaves no light on.
  if (group.text.size() + dark.size() <= light.packet_bytes) {
    group.text += dark;
    ++group.lines;
  }
  group.behind_lead_bytes = group.text.size() - lead.size();
  return group;
}

Result<std::string> SerialStage::answer_to(std::string_view question, Nanoseconds until) {
  if (const auto ok = send(question); !ok) return tl::unexpected{ok.error()};
  std::string all;
  while (true) {
    auto line = next_line(until);
    if (!line) return tl::unexpected{line.error()};
    note_temperature(*line);
    if (*line == "ok") return all;
    if (line->starts_with("ok ") || line->starts_with("error:")) return all + *line + "\n";
    all += *line + "\n";
  }
}

Result<void> SerialStage::check_board() {
  const Nanoseconds until = clock_.now() + kCheckTimeout;
  const BoardLight& light = *options_.light;
  const bool is_grbl = options_.dialect == StageDialect::Grbl;
  if (is_grbl != (light.command == LightCommand::Spindle))
    return fail(
        ErrorCode::InvalidInput,
        fmt::format("light.command = \"{}\" is not what this stage's board has; a GRBL board has its spindle, a "
                    "Marlin board a fan or a pin",
                    name_of(light.command)));
  if (const auto ok = is_grbl ? check_grbl(until) : check_marlin(until); !ok) return ok;
  const auto by = light.command == LightCommand::Spindle ? std::string{"spindle"}
                                                         : fmt::format("{} {}", name_of(light.command), light.number);
  light_facts_ = {fmt::format("light by the stage's board ({})", by),
                  step_of(options_.dialect),
                  kLongest,
                  step_of(options_.dialect),
                  lead_of(options_.dialect),
                  light.steps};
  return {};
}

Result<void> SerialStage::check_grbl(Nanoseconds until) {
  if (!banner_.starts_with("Grbl 1.1")) return unfit("its firmware is not GRBL 1.1: " + banner_);
  const auto build = answer_to("$I\n", until);
  if (!build) return tl::unexpected{build.error()};
  // "[OPT:V,15,128]": letters of the build, blocks that it plans, bytes that it receives.
  const auto options = build->find("[OPT:");
  if (options == std::string::npos ||
      build->substr(options, build->find(',', options) - options).find('V', 5) == std::string::npos)
    return unfit("it was built without a variable spindle, so that it has no laser mode");
  const auto bytes = build->rfind(',');
  if (bytes == std::string::npos || bytes < options ||
      std::from_chars(build->data() + bytes + 1, build->data() + build->size(), buffer_bytes_).ec != std::errc{} ||
      buffer_bytes_ < options_.light->packet_bytes)
    return unfit("it does not say that it receives an exposure at once: " + *build);
  const auto settings = answer_to("$$\n", until);
  if (!settings) return tl::unexpected{settings.error()};
  if (setting(*settings, "$32") != 1.0) return unfit("outside laser mode a hold would leave it on; set $32=1");
  const auto report = setting(*settings, "$10");
  if (!report || (static_cast<unsigned>(*report) & 2) == 0)
    return unfit("its report does not say what its buffers hold; set $10=3");
  const auto full = setting(*settings, "$30"), least = setting(*settings, "$31");
  if (!full || *full < 1 || *full > 9999) return unfit("$30 is not within 1 and 9999; set $30=1000");
  if (!least || *least != 0) return unfit("its least power is not 0; set $31=0");
  full_word_ = *full;
  return {};
}

Result<void> SerialStage::check_marlin(Nanoseconds until) {
  const auto firmware = answer_to("M115\n", until);
  if (!firmware) return tl::unexpected{firmware.error()};
  if (firmware->find("FIRMWARE_NAME:Marlin") == std::string::npos) return unfit("its firmware is not Marlin");
  if (firmware->find("Cap:EMERGENCY_PARSER:1") == std::string::npos)
    return unfit("its firmware was built without EMERGENCY_PARSER");
  const BoardLight& light = *options_.light;
  const bool is_fan = light.command == LightCommand::Fan;
  const auto off =
      answer_to(is_fan ? fmt::format("M107 P{}\n", light.number) : fmt::format("M42 P{} S0\n", light.number), until);
  if (!off) return tl::unexpected{off.error()};
  if (off->find("Unknown command") != std::string::npos)
    return unfit(is_fan ? "it knows no M106 and M107; it was built without a fan"
                        : "it knows no M42; it was built without DIRECT_PIN_CONTROL");
  if (off->find("rotected") != std::string::npos || off->find("rror") != std::string::npos)
    return unfit(fmt::format("it does not let pin {} be switched: {}", light.number, *off));
  full_word_ = kMarlinFull;
  return {};
}

Result<void> SerialStage::check_light(const LightOrder& order) const {
  if (!options_.light) return fail(ErrorCode::Internal, "stage: it has no light");
  const auto group = light_group(options_.dialect, *options_.light, full_word_, order);
  if (!group) return tl::unexpected{group.error()};
  return {};
}

Result<void> SerialStage::light(const LightOrder& order) {
  if (!options_.light) return fail(ErrorCode::Internal, "stage: it has no light");
  const auto group = light_group(options_.dialect, *options_.light, full_word_, order);
  if (!group) return tl::unexpected{group.error()};
  if (!connected_ || !homed_ || doing_ != Doing::Nothing)
    return fail(ErrorCode::Conflict, "stage: no light before it is homed and at rest");
  if (const auto ok = take_lines(); !ok) return fail(ErrorCode::DeviceRefused, ok.error().what);
  room_bytes_.reset();
  dark_questions_ = 0;
  oks_wanted_ = group->lines;
  doing_ = Doing::Lighting;
  light_unsure_ = true;
  const Nanoseconds lead_until = clock_.now() + light_facts_.lead;
  lit_from_ = lead_until;
  lit_until_ = lit_from_ + Nanoseconds{order.duration};
  deadline_ = lit_until_ + kLate;
  auto sent = line_->write(group->text, kWriteTimeout);
  if (sent && options_.dialect == StageDialect::Grbl) sent = check_received(*group);
  if (sent) return {};
  // Restarted well before its lead was over it has not shone; else nobody knows.
  const bool is_early = clock_.now() + kRestartReaches < lead_until;
  if (connect() && !light_unsure_ && is_early)
    return fail(ErrorCode::DeviceRefused, "before the light went on: " + sent.error().what);
  (void)unlight();
  return sent.error().code == ErrorCode::DeviceRefused ? fail(ErrorCode::DeviceTimeout, sent.error().what)
                                                       : tl::unexpected{sent.error()};
}

Result<void> SerialStage::check_received(const LightGroup& group) {
  if (const auto ok = send("?"); !ok) return ok;
  for (const Nanoseconds until = clock_.now() + light_facts_.lead / 2; clock_.now() < until; clock_.sleep_for(kWait)) {
    if (const auto ok = take_lines(); !ok) return ok;
    if (!room_bytes_) continue;
    const std::size_t held_bytes = buffer_bytes_ - std::min(buffer_bytes_, *room_bytes_);
    if (held_bytes == group.behind_lead_bytes || held_bytes == group.text.size()) return {};
    return fail(ErrorCode::DeviceRefused,
                fmt::format("stage: of an exposure of {} bytes its board holds {}", group.text.size(), held_bytes));
  }
  return fail(ErrorCode::DeviceTimeout, "stage: its board does not say what it holds of the exposure");
}

Result<void> SerialStage::take_light_line(const std::string& line) {
  if (options_.dialect == StageDialect::Marlin) {
    // Said of a line of the group that came garbled: light without its end, or an end without light.
    if (line.find("Unknown command") != std::string::npos)
      return lost(ErrorCode::DeviceRefused, "the board did not understand the exposure: " + line);
    return {};
  }
  if (!line.starts_with('<')) return {};
  if (const auto room = room_in(line)) room_bytes_ = room;
  if (line.starts_with("<Hold"))
    return lost(ErrorCode::DeviceRefused, "somebody holds the board in an exposure: " + line);
  if (doing_ != Doing::AskingDark) return {};
  const auto accessories = field(line, "|A:");
  if (accessories && accessories->find('S') != std::string_view::npos)
    return lost(ErrorCode::DeviceRefused, "its light is still on behind an exposure");
  // What is switched on stands in a report with the overrides, which come at once after a change.
  if (!field(line, "|Ov:") && ++dark_questions_ < kDarkQuestions) return send("?");
  doing_ = Doing::Nothing;
  light_unsure_ = false;
  return {};
}

Result<void> SerialStage::take_dark_ok() {
  if (clock_.now() < lit_until_ - kEarly)
    return lost(ErrorCode::DeviceRefused, "the board ended the exposure too early");
  if (options_.dialect == StageDialect::Grbl) {
    doing_ = Doing::AskingDark;
    deadline_ = clock_.now() + kLate;
    return send("?");
  }
  doing_ = Doing::Nothing;
  light_unsure_ = false;
  return {};
}

Result<StageLightStatus> SerialStage::poll_light() {
  if (const auto ok = take_lines(); !ok) return tl::unexpected{ok.error()};
  const bool is_lighting = doing_ == Doing::Lighting || doing_ == Doing::AskingDark;
  if (is_lighting && clock_.now() > deadline_) {
    connected_ = false;
    return lost(ErrorCode::DeviceTimeout, "its board does not say that the exposure is over");
  }
  return StageLightStatus{!is_lighting && !light_unsure_, lit_from_, lit_until_};
}

Result<void> SerialStage::unlight() {
  if (!options_.light || !light_unsure_) return {};
  // Nothing is asked before the restart: it is what darkens.
  if (connect() && !light_unsure_) return {};
  if (const auto ok = line_->reopen(); !ok) return ok;
  return connect();
}

}  // namespace telefab::fab
