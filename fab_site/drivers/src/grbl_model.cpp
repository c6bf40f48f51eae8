// SPDX-License-Identifier: GPL-3.0-or-later
#include <fmt/format.h>

#include <algorithm>
#include <charconv>
#include <cmath>
#include <telefab/fab/drivers/grbl_model.hpp>
#include <utility>
#include <vector>

#include "board_walk.hpp"

namespace telefab::fab {

using namespace std::chrono_literals;

namespace {

constexpr double kPullOff_mm = 1.0;  ///< MPos after homing is minus this
constexpr double kHoming_mm_per_s = 20;
constexpr double kFastest_mm_per_min = 3000;
constexpr std::size_t kReceiveBuffer = 128;
constexpr Nanoseconds kBoot = 500ms;
constexpr double kLostSteps_mm = 0.5;

std::optional<double> word(std::string_view line, char letter) {
  const std::size_t at = line.find(letter);
  if (at == std::string_view::npos) return std::nullopt;
  double value = 0;
  if (std::from_chars(line.data() + at + 1, line.data() + line.size(), value).ec != std::errc{}) return std::nullopt;
  return value;
}

bool has(std::string_view line, std::string_view code) {
  const std::size_t at = line.find(code);
  if (at == std::string_view::npos) return false;
  const std::size_t end = at + code.size();
  return end == line.size() || line[end] < '0' || line[end] > '9';
}

}  // namespace

std::string_view name_of(StageFault fault) {
  static constexpr std::string_view names[] = {"error:20",   "ALARM:1", "ALARM:2", "restart",
                                               "lost steps", "no ok",   "garbage", "hang up"};
  static_assert(std::size(names) == kStageFaults);
  return names[static_cast<std::size_t>(fault)];
}

GrblModel::GrblModel(double top_mm, const Clock& clock, MachineLog* log)
    : top_mm_{top_mm}, clock_{clock}, log_{log}, gap_mm_{log != nullptr ? log->z_mm() : 0} {
  restart();
}

void GrblModel::plan_fault(StageFault fault, std::uint64_t lines_from_now) {
  fault_ = {fault, lines_ + lines_from_now};
}

Nanoseconds GrblModel::idle_at() const { return motions_.empty() ? clock_.now() : motions_.back().until; }

void GrblModel::answer(std::string text, Nanoseconds due) {
  // Answers keep the order of their lines.
  if (!outgoing_.empty()) due = std::max(due, outgoing_.back().due);
  outgoing_.push_back({due, std::move(text)});
}

void GrblModel::stop_motion() {
  tick();
  if (!motions_.empty()) {
    const Motion& m = motions_.front();
    const double share =
        m.until > m.from
            ? std::clamp(double((clock_.now() - m.from).count()) / double((m.until - m.from).count()), 0.0, 1.0)
            : 1;
    gap_mm_ = m.from_mm + (m.to_mm - m.from_mm) * share;
    if (log_ != nullptr && clock_.now() > m.from) log_->moved({m.from, clock_.now(), m.from_mm, gap_mm_});
  }
  motions_.clear();
}

void GrblModel::restart() {
  stop_motion();
  locked_ = true;
  incoming_.clear();
  outgoing_.clear();
  boots_until_ = clock_.now() + kBoot;
  answer("\r\nGrbl 1.1h ['$' for help]\r\n[MSG:'$H'|'$X' to unlock]\r\n", boots_until_);
}

void GrblModel::reopened() {
  gone_ = false;
  restart();
}

void GrblModel::tick() {
  const Nanoseconds now = clock_.now();
  while (!motions_.empty() && motions_.front().until <= now) {
    const Motion m = motions_.front();
    motions_.pop_front();
    gap_mm_ = m.to_mm;
    if (m.homing) locked_ = false;
    if (log_ != nullptr) log_->moved({m.from, m.until, m.from_mm, m.to_mm});
  }
}

bool GrblModel::receive(std::string_view bytes) {
  tick();
  if (gone_) return false;
  for (const char c : bytes) {
    if (c == '\x18') {
      restart();
    } else if (clock_.now() < boots_until_) {
      continue;  // lost
    } else if (c == '?') {
      status();
    } else if (c == '!') {
      stop_motion();
    } else if (c == '~') {
      continue;
    } else if (c == '\n' || c == '\r') {
      if (!incoming_.empty()) execute(std::exchange(incoming_, {}));
      if (gone_) return false;
    } else if (incoming_.size() < kReceiveBuffer) {
      incoming_.push_back(c);
    }
  }
  return true;
}

std::string GrblModel::transmit() {
  tick();
  std::string text;
  while (!gone_ && !outgoing_.empty() && outgoing_.front().due <= clock_.now()) {
    text += outgoing_.front().text;
    outgoing_.pop_front();
  }
  return text;
}

void GrblModel::status() {
  const double z = gap_mm_ - top_mm_ - kPullOff_mm;
  const std::string_view state = locked_ ? "Alarm" : motions_.empty() ? "Idle" : "Run";
  // A status is not queued behind other answers: it is sent from the interrupt.
  outgoing_.push_front({clock_.now(), fmt::format("<{}|MPos:0.000,0.000,{:.3f}|FS:0,0>\r\n", state, z)});
}

void GrblModel::queue_move(double to_mm, double mm_per_s, bool homing) {
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

void GrblModel::execute(std::string_view line) {
  const std::uint64_t n = lines_++;
  now_.reset();
  if (fault_ && fault_->second == n) now_ = std::exchange(fault_, {})->first;
  if (now_ == StageFault::ErrorLine) return answer("error:20\r\n", clock_.now());
  if (now_ == StageFault::AlarmLost || now_ == StageFault::AlarmLimit) {
    stop_motion();
    locked_ = true;
    return answer(now_ == StageFault::AlarmLost ? "ALARM:1\r\n" : "ALARM:2\r\n", clock_.now());
  }
  if (now_ == StageFault::Restart) return restart();
  if (now_ == StageFault::HangUp) {
    stop_motion();
    locked_ = gone_ = true;
    return;
  }
  if (now_ == StageFault::Garbage) answer("\x7f\xfe~~#\r\n", clock_.now());
  const auto ok = [&](Nanoseconds due) {
    if (now_ != StageFault::NoOk) answer("ok\r\n", due);
  };
  if (line == "$H") {
    queue_move(top_mm_, kHoming_mm_per_s, true);
    return ok(idle_at());
  }
  if (line == "$X") {
    locked_ = false;
    return ok(clock_.now());
  }
  if (line == "$#") return answer("[G54:0.000,0.000,0.000]\r\n[PRB:0.000,0.000,0.000:0]\r\nok\r\n", clock_.now());
  if (line == "$N") return answer("$N0=\r\n$N1=\r\nok\r\n", clock_.now());
  if (line == "$G") return answer("[GC:G0 G54 G17 G21 G90 G94 M5 M9 T0 F0 S0]\r\nok\r\n", clock_.now());
  if (locked_) return answer("error:9\r\n", clock_.now());
  if (has(line, "G4")) return ok(idle_at() + 10ms);
  if (has(line, "G1")) {
    const auto z = word(line, 'Z');
    if (const auto feed = word(line, 'F')) feed_mm_per_min_ = *feed;
    if (feed_mm_per_min_ <= 0) return answer("error:22\r\n", clock_.now());
    if (!z || !has(line, "G53") || !has(line, "G90") || !has(line, "G21")) return answer("error:33\r\n", clock_.now());
    double to_mm = *z + kPullOff_mm + top_mm_;
    if (to_mm > top_mm_ + kPullOff_mm || to_mm < -1e-6) {
      stop_motion();
      locked_ = true;
      return answer("ALARM:2\r\n", clock_.now());
    }
    if (now_ == StageFault::LostSteps) to_mm += kLostSteps_mm;
    queue_move(to_mm, std::min(feed_mm_per_min_, kFastest_mm_per_min) / 60, false);
    return ok(clock_.now());
  }
  if (has(line, "G90") || has(line, "G21")) return ok(clock_.now());
  answer("error:20\r\n", clock_.now());
}

}  // namespace telefab::fab
