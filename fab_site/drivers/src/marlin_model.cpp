// SPDX-License-Identifier: GPL-3.0-or-later
#include <fmt/format.h>

#include <algorithm>
#include <charconv>
#include <cmath>
#include <telefab/fab/drivers/marlin_model.hpp>
#include <utility>
#include <vector>

namespace telefab::fab {

using namespace std::chrono_literals;

namespace {

constexpr Nanoseconds kBoot = 500ms;
constexpr Nanoseconds kBusyEvery = 2s;
constexpr Nanoseconds kReportEvery = 1s;
constexpr double kHoming_mm_per_s = 20;
constexpr double kFastest_mm_per_s = 50;
constexpr std::size_t kLongestLine = 96;
constexpr std::size_t kQueuedLines = 4;
constexpr std::size_t kReceiveBuffer = 128;
constexpr double kFullPwm = 255;

std::optional<double> number_after(std::string_view line, char letter) {
  const std::size_t at = line.find(letter, 1);
  if (at == std::string_view::npos) return std::nullopt;
  double value = 0;
  if (std::from_chars(line.data() + at + 1, line.data() + line.size(), value).ec != std::errc{}) return std::nullopt;
  return value;
}

/// "M106" of "M106P1 S255": a letter and its number.
std::string_view code_of(std::string_view line) {
  return line.substr(0, std::min(line.size(), line.find_first_not_of("0123456789", 1)));
}

}  // namespace

std::string_view name_of(MarlinFault fault) {
  static constexpr std::string_view names[] = {"garbled", "swallowed", "brown out", "cable lost"};
  static_assert(std::size(names) == kMarlinFaults);
  return names[static_cast<std::size_t>(fault)];
}

MarlinModel::MarlinModel(double top_mm, const Clock& clock, MachineLog* log, MarlinBoard board, MarlinLamp lamp)
    : top_mm_{top_mm},
      clock_{clock},
      log_{log},
      board_{board},
      wiring_{lamp},
      lamp_{log},
      gap_mm_{log != nullptr ? log->z_mm() : 0} {
  restart();
}

void MarlinModel::restart() {
  quick_stop();
  lamp_.set(0, clock_.now());
  homed_ = halted_ = waits_for_motion_ = reports_ = false;
  lines_in_.clear();
  buffered_bytes_ = 0;
  incoming_.clear();
  outgoing_.clear();
  at_ = busy_until_ = boot_until_ = clock_.now() + kBoot;
  answer_at("start\necho:Marlin 2.1.2", boot_until_);
}

void MarlinModel::reopened() {
  tick();
  is_unplugged_ = false;
  if (board_.restarts_on_open) restart();
}

void MarlinModel::halt() {
  quick_stop();
  lines_in_.clear();
  outgoing_.clear();
  halted_ = true;
  answer_at("Error:Thermal Runaway, system stopped! Heater_ID: bed\nError:Printer halted. kill() called!",
            clock_.now());
}

Nanoseconds MarlinModel::idle_at() const { return motions_.empty() ? at_ : std::max(at_, motions_.back().until); }

void MarlinModel::answer_at(const std::string& text, Nanoseconds due) {
  if (!outgoing_.empty()) due = std::max(due, outgoing_.back().due);
  outgoing_.push_back({due, text + "\n"});
}

void MarlinModel::end_motions(Nanoseconds until) {
  while (!motions_.empty() && motions_.front().until <= until) {
    const BoardMotion m = motions_.front();
    motions_.pop_front();
    gap_mm_ = m.to_mm;
    if (m.homing) homed_ = true;
    if (log_ != nullptr) log_->moved({m.from, m.until, m.from_mm, m.to_mm});
  }
}

void MarlinModel::tick() {
  const Nanoseconds now = clock_.now();
  while (!halted_ && !lines_in_.empty()) {
    const Nanoseconds start = std::max(lines_in_.front().came, busy_until_);
    if (start > now) break;
    const std::string line = std::move(lines_in_.front().text);
    lines_in_.pop_front();
    buffered_bytes_ -= line.size() + 1;
    at_ = busy_until_ = start;
    end_motions(at_);
    std::optional<MarlinFault> fault;
    if (fault_ && fault_->second == lines_) fault = std::exchange(fault_, {})->first;
    ++lines_;
    if (std::exchange(lose_line_, false) || fault == MarlinFault::Swallowed) continue;
    if (fault == MarlinFault::CableLost) is_unplugged_ = true;
    if (fault == MarlinFault::BrownOut)
      restart();
    else
      execute(fault == MarlinFault::Garbled ? "M9" + line : line);
  }
  at_ = now;
  end_motions(now);
}

void MarlinModel::quick_stop() {
  const Nanoseconds now = clock_.now();
  end_motions(now);
  if (!motions_.empty()) {
    const BoardMotion& m = motions_.front();
    const double share = double((now - m.from).count()) / double((m.until - m.from).count());
    gap_mm_ = m.from_mm + (m.to_mm - m.from_mm) * std::clamp(share, 0.0, 1.0);
    if (log_ != nullptr && now > m.from) log_->moved({m.from, now, m.from_mm, gap_mm_});
    homed_ = homed_ && !m.homing;
  }
  motions_.clear();
  if (!waits_for_motion_ || busy_until_ <= now) return;
  // What waited for the motion is over now, and its answer comes.
  busy_until_ = now;
  std::erase_if(outgoing_, [&](const Pending& p) { return p.due > now && p.is_busy; });
  for (Pending& p : outgoing_) p.due = std::min(p.due, now);
}

void MarlinModel::queue_move(double to_mm, double mm_per_s, bool homing) {
  fab::queue_move(motions_, idle_at(), gap_mm_, to_mm, mm_per_s, homing, at_, acceleration_mm_per_s2_);
}

bool MarlinModel::receive(std::string_view bytes) {
  tick();
  if (is_unplugged_) return false;
  if (halted_) return true;
  for (const char c : bytes) {
    if (clock_.now() < boot_until_) continue;  // lost
    if (c != '\n' && c != '\r') {
      if (incoming_.size() < kLongestLine) incoming_.push_back(c);
      continue;
    }
    if (incoming_.empty()) continue;  // an empty line is no command
    const std::string line = std::exchange(incoming_, {});
    if (board_.has_emergency_parser && code_of(line) == "M410") quick_stop();
    if (lines_in_.size() >= kQueuedLines && buffered_bytes_ + line.size() > kReceiveBuffer) continue;
    buffered_bytes_ += line.size() + 1;
    lines_in_.push_back({clock_.now(), line});
    tick();
  }
  return true;
}

std::string MarlinModel::transmit() {
  tick();
  if (is_unplugged_) return {};
  const Nanoseconds now = clock_.now();
  std::string text;
  while (!outgoing_.empty() && outgoing_.front().due <= now) {
    text += outgoing_.front().text;
    outgoing_.pop_front();
  }
  if (reports_ && !halted_ && now >= boot_until_ && now >= next_report_) {
    next_report_ = now + kReportEvery;
    text += " " + temperatures() + "\n";
  }
  return text;
}

std::string MarlinModel::temperatures() const {
  return fmt::format("T:{:.2f} /0.00 B:{:.2f} /0.00 C:{:.2f} /0.00 @:0 B@:0", hotend_celsius, bed_celsius,
                     chamber_celsius);
}

void MarlinModel::execute(const std::string& line) {
  const std::string_view code = code_of(line);
  waits_for_motion_ = false;
  if (code == "M105") return answer("ok" + (board_.has_thermistors ? " " + temperatures() : std::string{" @:0"}));
  if (!move(code, line) && !report(code, line) && !switch_lamp(code, line))
    answer(fmt::format("echo:Unknown command: \"{}\"", line));
  for (Nanoseconds busy = at_ + kBusyEvery; busy < busy_until_; busy += kBusyEvery)
    outgoing_.push_back({busy, "echo:busy: processing\n", true});
  answer_at("ok", busy_until_);
}

bool MarlinModel::move(std::string_view code, const std::string& line) {
  if (code == "G28") {
    homed_ = false;
    queue_move(top_mm_, kHoming_mm_per_s, true);
  }
  if (code == "G28" || code == "M400") {
    waits_for_motion_ = true;
    wait_until(idle_at());
    return true;
  }
  if (code == "G4") {
    const auto ms = number_after(line, 'P'), seconds = number_after(line, 'S');
    const double dwell_s = seconds ? *seconds : ms.value_or(0) / 1000;
    wait_until(idle_at() + Nanoseconds{static_cast<Nanoseconds::rep>(std::floor(dwell_s * 1000) * 1e6)});
    if (board_.z_sync) answer_at("Z_move_comp", busy_until_);
    return true;
  }
  if (code != "G1") return code == "G90" || code == "M410";
  if (const auto feed = number_after(line, 'F')) feed_mm_per_min_ = *feed;
  const auto z = number_after(line, 'Z');
  if (!homed_)
    answer("echo:Home Z First");
  else if (z && feed_mm_per_min_ > 0)
    queue_move(std::clamp(*z, 0.0, top_mm_), std::min(feed_mm_per_min_ / 60, kFastest_mm_per_s), false);
  return true;
}

bool MarlinModel::report(std::string_view code, const std::string& line) {
  if (code == "M114") {
    answer(fmt::format("X:0.00 Y:0.00 Z:{:.2f} E:0.00 Count X:0 Y:0 Z:{}", gap_mm_, std::lround(gap_mm_ * 400)));
  } else if (code == "M115") {
    answer(fmt::format("FIRMWARE_NAME:{} 2.1.2 (Jan 1 2024 12:00:00) PROTOCOL_VERSION:1.0\nCap:EMERGENCY_PARSER:{}",
                       board_.is_marlin ? "Marlin" : "Repetier", board_.has_emergency_parser ? 1 : 0));
  } else if (code == "M118") {
    answer(line.substr(std::min<std::size_t>(line.size(), 5)));
  } else if (code == "M155" && board_.reports_temperatures) {
    reports_ = number_after(line, 'S').value_or(0) > 0;
    next_report_ = at_ + kReportEvery;
  } else {
    return false;
  }
  return true;
}

bool MarlinModel::switch_lamp(std::string_view code, const std::string& line) {
  const auto number = static_cast<std::uint32_t>(number_after(line, 'P').value_or(0));
  const double s = std::clamp(number_after(line, 'S').value_or(kFullPwm), 0.0, kFullPwm);
  if ((code == "M106" || code == "M107") && board_.fans > 0) {
    if (number < board_.fans) drive_lamp(true, number, code == "M106" ? s : 0);
    return true;  // one that was not built is ignored without a word
  }
  if (code != "M42" || !board_.switches_pins) return false;
  if (number == board_.protected_pin)
    answer("Error:Pin " + std::to_string(number) + " is protected");
  else
    drive_lamp(false, number, s);
  return true;
}

void MarlinModel::drive_lamp(bool is_fan, std::uint32_t number, double s) {
  if (is_fan != wiring_.is_fan || number != wiring_.number) return;
  // A fan follows the block that moves; another pin at once.
  const Nanoseconds when = is_fan ? idle_at() : at_;
  if (is_fan && board_.queues_fans) wait_until(when);
  lamp_.set(s / kFullPwm, when);
}

}  // namespace telefab::fab
