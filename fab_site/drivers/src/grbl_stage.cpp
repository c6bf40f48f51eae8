// SPDX-License-Identifier: GPL-3.0-or-later
#include <fmt/format.h>

#include <array>
#include <charconv>
#include <cmath>
#include <telefab/fab/drivers/grbl_stage.hpp>

namespace telefab::fab {

using namespace std::chrono_literals;

namespace {

constexpr Milliseconds kWriteTimeout{500};
constexpr Nanoseconds kBannerTimeout = 4s;
constexpr Nanoseconds kAnswerTimeout = 2s;
constexpr Nanoseconds kWait = 10ms;
constexpr int kLinesPerPoll = 64;
constexpr std::size_t kMostLegs = 2;  ///< what a receive buffer of 128 bytes holds at once
constexpr Nanoseconds kStale = 2s;    ///< a reading older than this is asked for again
constexpr Nanoseconds kSilentThermometer = 5s;
constexpr double kFarthest_mm = 10'000;  ///< what no board calls the end of its axis; garbled, no move would be right

/// What differs between the two firmwares.
struct DialectFacts {
  std::string_view name;
  std::string_view reset;     ///< restarts the board
  std::string_view banner;    ///< how its first line begins
  std::string_view home;      ///< answered when at the end
  std::string_view move;      ///< fmt: z, speed in mm/min; then the barrier
  std::string_view barrier;   ///< answered when nothing moves any more
  std::string_view ask;       ///< for the position
  std::string_view position;  ///< the number follows this (GRBL: the third one)
  int numbers_before_z;
  std::string_view hold;
  std::string_view busy;  ///< a line that only says "wait"
};

constexpr DialectFacts kGrbl{"GRBL",  "\x18", "Grbl ", "$H\n", "G90 G21 G53 G1 Z{:.4f} F{:.2f}\n", "G4 P0.01\n", "?",
                             "MPos:", 2,      "!\x18", ""};
// Marlin has no line that restarts it without cutting its heaters and motors; opening the port does. One that did not
// restart answers the question for its temperatures; empty lines it does not answer.
constexpr DialectFacts kMarlin{"Marlin",   "\nM105\n", "start", "G28 Z\n", "G90\nG1 Z{:.4f} F{:.2f}\n",
                               "M400\n",   "M114\n",   "Z:",    0,         "M410\n",
                               "echo:busy"};

/// A question to a GRBL board and what stands in its answer, locked or not, in 0.9 as in 1.1.
struct GrblQuestion {
  std::string_view text;
  std::string_view mark;
};
constexpr std::array kGrblQuestions{GrblQuestion{"$#\n", "[G54:"}, GrblQuestion{"$N\n", "$N0="},
                                    GrblQuestion{"$G\n", " G9"}};

const DialectFacts& facts_of(StageDialect d) { return d == StageDialect::Grbl ? kGrbl : kMarlin; }

/// The `skip`-th number behind `mark`, numbers being separated by commas.
std::optional<double> number_behind(std::string_view line, std::string_view mark, int skip) {
  std::size_t at = line.find(mark);
  if (at == std::string_view::npos) return std::nullopt;
  at += mark.size();
  for (; skip > 0; --skip) {
    at = line.find(',', at);
    if (at == std::string_view::npos) return std::nullopt;
    ++at;
  }
  double value = 0;
  const auto [end, error] = std::from_chars(line.data() + at, line.data() + line.size(), value);
  if (error != std::errc{} || !std::isfinite(value)) return std::nullopt;
  return value;
}

bool is_ok(std::string_view line) { return line == "ok" || line.starts_with("ok "); }

int lines_in(std::string_view text) {
  int n = 0;
  for (const char c : text) n += c == '\n';
  return n;
}

}  // namespace

std::optional<double> celsius_in(std::string_view report, Thermometer thermometer) {
  constexpr std::string_view marks[] = {"", "T:", "B:", "C:"};
  const std::string_view mark = marks[static_cast<std::size_t>(thermometer)];
  if (mark.empty()) return std::nullopt;
  for (std::size_t at = 0; (at = report.find(mark, at)) != std::string_view::npos; at += mark.size()) {
    if (at > 0 && report[at - 1] != ' ') continue;  // the end of another word
    std::string_view number = report.substr(at + mark.size());
    number.remove_prefix(std::min(number.find_first_not_of(' '), number.size()));
    double value = 0;
    const auto [end, error] = std::from_chars(number.data(), number.data() + number.size(), value);
    if (error == std::errc{} && std::isfinite(value)) return value;
  }
  return std::nullopt;
}

Result<std::unique_ptr<SerialStage>> SerialStage::open(std::unique_ptr<LineTransport> line,
                                                       const SerialStageOptions& options, Clock& clock) {
  if (!(options.top_mm > 0) || !(options.fastest_mm_per_s > 0) || !(options.homing_mm_per_s > 0))
    return fail(ErrorCode::InvalidInput, "stage: its travel and its speeds must be positive");
  std::unique_ptr<SerialStage> stage{new SerialStage{std::move(line), options, clock}};
  stage->facts_ = {std::string{facts_of(options.dialect).name} + " stage",
                   0,
                   options.top_mm,
                   options.fastest_mm_per_s,
                   options.homing_mm_per_s,
                   0.01};
  if (const auto ok = stage->connect(); !ok) return tl::unexpected{ok.error()};
  return stage;
}

SerialStage::~SerialStage() {
  if (light_unsure_) (void)unlight();
  if (doing_ != Doing::Nothing) (void)line_->write(facts_of(options_.dialect).hold, kWriteTimeout);
}

Result<void> SerialStage::send(std::string_view text) { return line_->write(text, kWriteTimeout); }

tl::unexpected<Error> SerialStage::lost(ErrorCode code, std::string what) {
  homed_ = false;
  doing_ = Doing::Nothing;
  return fail(code, "stage: " + std::move(what));
}

Result<void> SerialStage::connect() {
  connected_ = homed_ = false;
  doing_ = Doing::Nothing;
  const DialectFacts& dialect = facts_of(options_.dialect);
  const bool is_marlin = options_.dialect == StageDialect::Marlin;
  // A light at a Marlin board is surely off after a restart alone, and its port's opening is the only one there is.
  const bool must_restart = is_marlin && options_.light;
  if (must_restart)
    if (const auto ok = line_->reopen(); !ok) return ok;
  if (const auto ok = send(dialect.reset); !ok) return ok;
  const Nanoseconds until = clock_.now() + kBannerTimeout;
  while (true) {
    const auto line = next_line(until);
    if (!line && line.error().code == ErrorCode::DeviceTimeout && must_restart)
      return fail(ErrorCode::DeviceRefused,
                  "stage: the board does not restart when its port is opened, so that nothing would darken its light "
                  "at once; a board with its own USB port cannot time the light (fab_site/drivers/first-light.md)");
    if (!line && line.error().code == ErrorCode::DeviceTimeout)
      return fail(ErrorCode::DeviceTimeout,
                  fmt::format("stage: no {} banner; is it the right port and firmware?", dialect.name));
    if (!line) return tl::unexpected{line.error()};
    if (line->starts_with(dialect.banner)) banner_ = *line;
    if (line->starts_with(dialect.banner) || (is_marlin && !must_restart && is_ok(*line))) break;
  }
  if (const auto ok = is_marlin ? synchronise_marlin(until) : synchronise_grbl(until); !ok) return ok;
  // A restart of either firmware leaves its pins off.
  if (!is_marlin || must_restart) light_unsure_ = false;
  if (options_.light)
    if (const auto ok = check_board(); !ok) return ok;
  connected_ = true;
  return {};
}

Result<std::string> SerialStage::next_line(Nanoseconds until) {
  while (clock_.now() < until) {
    auto line = line_->read_line(Milliseconds{0});
    if (!line) return tl::unexpected{line.error()};
    if (*line) return std::move(**line);
    clock_.sleep_for(kWait);
  }
  return fail(ErrorCode::DeviceTimeout, "stage: the board does not answer");
}

Result<void> SerialStage::synchronise_grbl(Nanoseconds until) {
  // The banner may be of an earlier restart: of a program that was killed, or of the port's opening. Ours comes later
  // and loses what was sent before it, so that each banner asks another question; the answer to the newest one, and its
  // ok, come behind all that.
  for (const GrblQuestion& question : kGrblQuestions) {
    if (const auto ok = send(question.text); !ok) return ok;
    bool is_answered = false;
    while (true) {
      const auto line = next_line(until);
      if (!line) return tl::unexpected{line.error()};
      if (line->starts_with(kGrbl.banner)) break;
      if (is_answered && is_ok(*line)) return {};
      is_answered = is_answered || line->find(question.mark) != std::string::npos;
    }
  }
  return fail(ErrorCode::DeviceRefused, "stage: the board restarts again and again; look at its power");
}

Result<void> SerialStage::synchronise_marlin(Nanoseconds until) {
  idle_oks_ = 0;
  asked_celsius_at_.reset();
  celsius_at_ = clock_.now();
  const std::string_view reports = options_.thermometer == Thermometer::None ? "" : "M155 S1\n";
  // Answers keep the order of their lines: behind the echo of a word never said before only its own ok can come. A
  // board that does not know M118 says so and repeats the word.
  const std::string word = fmt::format("telefab-{}", ++probes_);
  if (const auto ok = send(fmt::format("{}M118 {}\n", reports, word)); !ok) return ok;
  bool is_echoed = false;
  while (true) {
    const auto line = next_line(until);
    if (!line) return tl::unexpected{line.error()};
    note_temperature(*line);
    if (is_echoed && is_ok(*line)) return {};
    is_echoed = is_echoed || line->find(word) != std::string::npos;
  }
}

void SerialStage::note_temperature(std::string_view line) {
  if (const auto celsius = celsius_in(line, options_.thermometer)) {
    celsius_ = celsius;
    celsius_at_ = clock_.now();
    asked_celsius_at_.reset();
  }
}

Result<std::optional<double>> SerialStage::celsius() {
  if (options_.thermometer == Thermometer::None || options_.dialect != StageDialect::Marlin) return std::nullopt;
  if (doing_ != Doing::Nothing) return celsius_;  // poll() hears what comes
  if (!connected_) return celsius_;               // home() connects again
  if (const auto ok = take_lines(); !ok) return tl::unexpected{ok.error()};
  const Nanoseconds now = clock_.now();
  if (asked_celsius_at_ && now - *asked_celsius_at_ > kSilentThermometer) {
    asked_celsius_at_.reset();
    return lost(ErrorCode::DeviceTimeout, "the board says nothing of the resin's thermometer; is it the right sensor?");
  }
  if (!asked_celsius_at_ && now - celsius_at_ > kStale) {
    if (const auto ok = send("M105\n"); !ok) return tl::unexpected{ok.error()};
    ++idle_oks_;
    asked_celsius_at_ = now;
  }
  return celsius_;
}

Result<void> SerialStage::home() {
  if (doing_ != Doing::Nothing || !connected_) {
    // Whatever it was doing, it starts from a known state; a lost line is opened again.
    if (!connect()) {
      if (const auto ok = line_->reopen(); !ok) return ok;
      if (const auto ok = connect(); !ok) return ok;
    }
  }
  homed_ = false;
  if (const auto ok = send(facts_of(options_.dialect).home); !ok) {
    connected_ = false;
    return ok;
  }
  doing_ = Doing::Homing;
  oks_wanted_ = 1;
  const StageLeg up{options_.top_mm, options_.homing_mm_per_s};
  deadline_ = clock_.now() + path_deadline(0, {&up, 1}, options_.acceleration_mm_per_s2);
  return {};
}

Result<void> SerialStage::move_along(std::span<const StageLeg> legs) {
  if (legs.empty() || legs.size() > kMostLegs)
    return fail(ErrorCode::InvalidInput,
                fmt::format("stage: a path of {} legs; 1 to {} are possible", legs.size(), kMostLegs));
  for (const StageLeg& leg : legs) {
    if (!(leg.z_mm >= facts_.lowest_mm && leg.z_mm <= facts_.highest_mm))
      return fail(ErrorCode::InvalidInput,
                  fmt::format("stage: a target of {} mm is outside 0 to {} mm", leg.z_mm, facts_.highest_mm));
    if (!(leg.speed_mm_per_s > 0 && leg.speed_mm_per_s <= facts_.fastest_mm_per_s))
      return fail(ErrorCode::InvalidInput, fmt::format("stage: a speed of {} mm/s is not within 0 and {} mm/s",
                                                       leg.speed_mm_per_s, facts_.fastest_mm_per_s));
  }
  if (!homed_) return fail(ErrorCode::Conflict, "stage: not homed");
  if (doing_ != Doing::Nothing) return fail(ErrorCode::Conflict, "stage: still moving");
  const DialectFacts& dialect = facts_of(options_.dialect);
  std::string text;
  for (const StageLeg& leg : legs)
    text +=
        fmt::format(fmt::runtime(dialect.move), board_top_mm_ + leg.z_mm - options_.top_mm, leg.speed_mm_per_s * 60);
  text += dialect.barrier;
  doing_ = Doing::Moving;
  oks_wanted_ = lines_in(text);
  target_mm_ = legs.back().z_mm;
  deadline_ = clock_.now() + path_deadline(z_mm_, legs, options_.acceleration_mm_per_s2);
  if (const auto ok = send(text); !ok) return lost(ok.error().code, ok.error().what);
  return {};
}

Result<void> SerialStage::tilt(Nanoseconds) {
  return fail(ErrorCode::InvalidInput, "stage: it tips no vat; set motion.tilt_s to 0");
}

Result<StageStatus> SerialStage::poll() {
  if (const auto ok = take_lines(); !ok) return tl::unexpected{ok.error()};
  if (doing_ != Doing::Nothing && clock_.now() > deadline_) {
    (void)send(facts_of(options_.dialect).hold);
    connected_ = false;
    return lost(ErrorCode::DeviceTimeout, "it did not come to rest in time; held");
  }
  return StageStatus{doing_ != Doing::Nothing, homed_, z_mm_};
}

Result<void> SerialStage::take_lines() {
  for (int i = 0; i < kLinesPerPoll; ++i) {
    const auto line = line_->read_line(Milliseconds{0});
    if (!line) {
      connected_ = false;
      return lost(line.error().code, line.error().what);
    }
    if (!*line) break;
    if (const auto ok = take(**line); !ok) return ok;
  }
  return {};
}

Result<void> SerialStage::take(const std::string& line) {
  const DialectFacts& dialect = facts_of(options_.dialect);
  if (options_.dialect == StageDialect::Marlin) note_temperature(line);
  if (line == "ok" || (options_.dialect == StageDialect::Marlin && is_ok(line))) return take_ok();
  if (line.starts_with(dialect.banner))
    return lost(ErrorCode::DeviceRefused, "the board restarted; the position is lost");
  if (line.starts_with("ALARM") || line.starts_with("Error:") || line.starts_with("error:")) {
    connected_ = false;
    return lost(ErrorCode::DeviceRefused, "the board says " + line);
  }
  if (doing_ == Doing::Lighting || doing_ == Doing::AskingDark) return take_light_line(line);
  if (doing_ == Doing::AskingHome || doing_ == Doing::AskingRest) {
    const bool busy = options_.dialect == StageDialect::Grbl && line.starts_with("<") && !line.starts_with("<Idle");
    const auto z = number_behind(line, dialect.position, dialect.numbers_before_z);
    if (z && !busy) return take_position(*z);
    if (busy) return send(dialect.ask);
  }
  return {};  // messages, settings, busy lines, noise
}

Result<void> SerialStage::take_ok() {
  if (idle_oks_ > 0) {
    --idle_oks_;
    return {};
  }
  if (oks_wanted_ == 0 || --oks_wanted_ > 0) return {};
  if (doing_ == Doing::Homing) doing_ = Doing::AskingHome;
  if (doing_ == Doing::Moving) doing_ = Doing::AskingRest;
  if (doing_ == Doing::Lighting) return take_dark_ok();
  if (doing_ != Doing::AskingHome && doing_ != Doing::AskingRest) return {};
  deadline_ = clock_.now() + kAnswerTimeout;
  return send(facts_of(options_.dialect).ask);
}

Result<void> SerialStage::take_position(double reported_mm) {
  if (doing_ == Doing::AskingHome) {
    if (std::abs(reported_mm) > kFarthest_mm)
      return lost(ErrorCode::DeviceRefused, fmt::format("homed, it says it is at {} mm", reported_mm));
    board_top_mm_ = reported_mm;
    z_mm_ = options_.top_mm;
  } else {
    z_mm_ = reported_mm - board_top_mm_ + options_.top_mm;
    if (std::abs(z_mm_ - target_mm_) > facts_.steps_tolerance_mm)
      return lost(ErrorCode::DeviceRefused,
                  fmt::format("came to rest at {:.3f} mm instead of {:.3f} mm", z_mm_, target_mm_));
  }
  doing_ = Doing::Nothing;
  homed_ = true;
  return {};
}

Result<void> SerialStage::hold() {
  homed_ = false;
  doing_ = Doing::Nothing;
  connected_ = false;  // the next home() restarts the board and so empties its planner
  return send(facts_of(options_.dialect).hold);
}

}  // namespace telefab::fab
