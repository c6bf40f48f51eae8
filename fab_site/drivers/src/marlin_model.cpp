// SPDX-License-Identifier: GPL-3.0-or-later
#include <fmt/format.h>

#include <algorithm>
#include <charconv>
#include <cmath>
#include <telefab/fab/drivers/marlin_model.hpp>
#include <utility>
#include <vector>

#include "board_walk.hpp"

namespace telefab::fab {

using namespace std::chrono_literals;

namespace {

constexpr Nanoseconds kBoot = 500ms;
constexpr Nanoseconds kBusyEvery = 2s;
constexpr Nanoseconds kReportEvery = 1s;
constexpr double kHoming_mm_per_s = 20;
constexpr double kFastest_mm_per_s = 50;
constexpr std::size_t kLongestLine = 96;

std::optional<double> number_after(std::string_view line, char letter) {
  const std::size_t at = line.find(letter, 1);
  if (at == std::string_view::npos) return std::nullopt;
  double value = 0;
  if (std::from_chars(line.data() + at + 1, line.data() + line.size(), value).ec != std::errc{}) return std::nullopt;
  return value;
}

std::string_view code_of(std::string_view line) { return line.substr(0, line.find(' ')); }

}  // namespace

MarlinModel::MarlinModel(double top_mm, const Clock& clock, MachineLog* log, MarlinBoard board)
    : top_mm_{top_mm}, clock_{clock}, log_{log}, board_{board}, gap_mm_{log != nullptr ? log->z_mm() : 0} {
  restart();
}

void MarlinModel::restart() {
  quick_stop();
  homed_ = halted_ = waiting_ = reports_ = false;
  lines_.clear();
  incoming_.clear();
  outgoing_ = "start\necho:Marlin 2.1.2\n";
  boot_until_ = clock_.now() + kBoot;
}

void MarlinModel::reopened() { restart(); }

void MarlinModel::halt() {
  quick_stop();
  halted_ = true;
  outgoing_ += "Error:Thermal Runaway, system stopped! Heater_ID: bed\nError:Printer halted. kill() called!\n";
}

void MarlinModel::tick() {
  const Nanoseconds now = clock_.now();
  while (!motions_.empty() && motions_.front().until <= now) {
    const Motion m = motions_.front();
    motions_.pop_front();
    gap_mm_ = m.to_mm;
    if (m.homing) homed_ = true;
    if (log_ != nullptr) log_->moved({m.from, m.until, m.from_mm, m.to_mm});
  }
}

void MarlinModel::quick_stop() {
  tick();
  if (!motions_.empty()) {
    const Motion& m = motions_.front();
    const double share = double((clock_.now() - m.from).count()) / double((m.until - m.from).count());
    gap_mm_ = m.from_mm + (m.to_mm - m.from_mm) * std::clamp(share, 0.0, 1.0);
    if (log_ != nullptr && clock_.now() > m.from) log_->moved({m.from, clock_.now(), m.from_mm, gap_mm_});
    homed_ = homed_ && !m.homing;
  }
  motions_.clear();
}

void MarlinModel::queue_move(double to_mm, double mm_per_s, bool homing) {
  const double from_mm = motions_.empty() ? gap_mm_ : motions_.back().to_mm;
  const Nanoseconds from = motions_.empty() ? clock_.now() : motions_.back().until;
  const auto takes = Nanoseconds{static_cast<Nanoseconds::rep>(std::abs(to_mm - from_mm) / mm_per_s * 1e9)};
  motions_.push_back({from, from + takes, from_mm, to_mm, homing, mm_per_s, clock_.now()});
  if (acceleration_mm_per_s2_ <= 0) return;
  // What came at one time is planned as one path.
  const auto first =
      std::find_if(motions_.begin(), motions_.end(), [now = clock_.now()](const Motion& m) { return m.queued == now; });
  std::vector<BoardMove> moves;
  for (auto m = first; m != motions_.end(); ++m) moves.push_back({m->to_mm, m->mm_per_s});
  const auto times = walk(first->from_mm, moves, acceleration_mm_per_s2_);
  Nanoseconds at = first->from;
  for (std::size_t i = 0; i < times.size(); ++i) {
    Motion& m = *(first + static_cast<std::ptrdiff_t>(i));
    m.from = at;
    m.until = at += times[i];
  }
}

bool MarlinModel::receive(std::string_view bytes) {
  tick();
  if (halted_) return true;
  for (const char c : bytes) {
    if (c != '\n' && c != '\r') {
      if (incoming_.size() < kLongestLine) incoming_.push_back(c);
      continue;
    }
    if (incoming_.empty()) continue;  // an empty line is no command
    if (code_of(incoming_) == "M410") quick_stop();
    lines_.push_back(std::move(incoming_));
    incoming_.clear();
  }
  work();
  return true;
}

std::string MarlinModel::transmit() {
  tick();
  if (clock_.now() < boot_until_) return {};
  work();
  if (reports_ && !halted_ && clock_.now() >= next_report_) {
    next_report_ = clock_.now() + kReportEvery;
    answer(" " + temperatures());
  }
  return std::exchange(outgoing_, {});
}

std::string MarlinModel::temperatures() const {
  return fmt::format("T:{:.2f} /0.00 B:{:.2f} /0.00 C:{:.2f} /0.00 @:0 B@:0", hotend_celsius, bed_celsius,
                     chamber_celsius);
}

void MarlinModel::work() {
  while (!halted_ && clock_.now() >= boot_until_ && !lines_.empty()) {
    if (!waiting_ && std::exchange(lose_line_, false)) {
      lines_.pop_front();
      continue;
    }
    if (!execute(lines_.front())) {
      if (clock_.now() >= next_busy_) {
        answer("echo:busy: processing");
        next_busy_ = clock_.now() + kBusyEvery;
      }
      return;
    }
    waiting_ = false;
    lines_.pop_front();
  }
}

bool MarlinModel::execute(const std::string& line) {
  const std::string_view code = code_of(line);
  const auto wait = [&] {
    if (!std::exchange(waiting_, true)) next_busy_ = clock_.now() + kBusyEvery;
    return false;
  };
  if (code == "G28") {
    if (!waiting_) {
      homed_ = false;
      queue_move(top_mm_, kHoming_mm_per_s, true);
    }
    tick();
    if (!motions_.empty()) return wait();
  } else if (code == "M400") {
    if (!motions_.empty()) return wait();
  } else if (code == "G1") {
    if (const auto feed = number_after(line, 'F')) feed_mm_per_min_ = *feed;
    const auto z = number_after(line, 'Z');
    if (!homed_)
      answer("echo:Home Z First");
    else if (z && feed_mm_per_min_ > 0)
      queue_move(std::clamp(*z, 0.0, top_mm_), std::min(feed_mm_per_min_ / 60, kFastest_mm_per_s), false);
  } else if (code == "M114") {
    answer(fmt::format("X:0.00 Y:0.00 Z:{:.2f} E:0.00 Count X:0 Y:0 Z:{}", gap_mm_, std::lround(gap_mm_ * 400)));
  } else if (code == "M105") {
    answer("ok" + (board_.has_thermistors ? " " + temperatures() : std::string{" @:0"}));
    return true;
  } else if (code == "M118") {
    answer(line.substr(std::min<std::size_t>(line.size(), 5)));
  } else if (code == "M155" && board_.reports_temperatures) {
    reports_ = number_after(line, 'S').value_or(0) > 0;
    next_report_ = clock_.now() + kReportEvery;
  } else if (code != "G90" && code != "M410") {
    answer(fmt::format("echo:Unknown command: \"{}\"", line));
  }
  answer("ok");
  return true;
}

}  // namespace telefab::fab
