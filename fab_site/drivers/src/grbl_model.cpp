// SPDX-License-Identifier: GPL-3.0-or-later
#include <fmt/format.h>

#include <algorithm>
#include <charconv>
#include <cmath>
#include <telefab/fab/drivers/grbl_model.hpp>
#include <utility>
#include <vector>

namespace telefab::fab {

using namespace std::chrono_literals;

namespace {

constexpr double kPullOff_mm = 1.0;  ///< MPos after homing is minus this
constexpr double kHoming_mm_per_s = 20;
constexpr double kFastest_mm_per_min = 3000;
constexpr Nanoseconds kBoot = 500ms;
constexpr double kLostSteps_mm = 0.5;

/// Steps of the busy wait of a G4, counted as the firmware does: in single precision.
Nanoseconds dwell(double seconds) {
  constexpr Nanoseconds kStep = 50ms;
  constexpr float kStepsPerSecond = 20;
  const auto steps = static_cast<std::int64_t>(std::ceil(static_cast<float>(seconds) * kStepsPerSecond));
  return std::clamp<std::int64_t>(steps, 0, 65535) * kStep;
}

}  // namespace

/// The words of one line.
struct GrblModel::Block {
  std::string_view error;  ///< of the whole line; empty: none
  bool g1 = false, g4 = false, g53 = false, g90 = false, g21 = false;
  std::optional<bool> spindle;
  std::optional<double> z, f, p, s;

  static Block of(std::string_view line) {
    Block block;
    std::size_t at = 0;
    while (at < line.size()) {
      if (line[at] == ' ') {
        ++at;
        continue;
      }
      const char letter = line[at++];
      if (letter < 'A' || letter > 'Z') return {.error = "error:1"};
      double value = 0;
      const auto [end, problem] = std::from_chars(line.data() + at, line.data() + line.size(), value);
      if (problem != std::errc{}) return {.error = "error:2"};
      at = static_cast<std::size_t>(end - line.data());
      if (!block.take(letter, value)) return {.error = "error:20"};
      if (!block.error.empty()) return block;
    }
    return block;
  }

 private:
  bool take(char letter, double value) {
    const auto flag = [&](bool& once) {
      if (once) error = "error:21";  // two of a modal group
      return once = true;
    };
    const auto number = [&](std::optional<double>& once, bool may_be_negative) {
      if (once) error = "error:25";
      if (value < 0 && !may_be_negative) error = "error:4";
      once = value;
      return true;
    };
    if (letter == 'G' && value == 1) return flag(g1);
    if (letter == 'G' && value == 4) return flag(g4);
    if (letter == 'G' && value == 53) return flag(g53);
    if (letter == 'G' && value == 90) return flag(g90);
    if (letter == 'G' && value == 21) return flag(g21);
    if (letter == 'M' && (value == 3 || value == 5)) {
      if (spindle) error = "error:21";
      spindle = value == 3;
      return true;
    }
    if (letter == 'Z') return number(z, true);
    if (letter == 'F') return number(f, false);
    if (letter == 'P') return number(p, false);
    if (letter == 'S') return number(s, false);
    return false;
  }
};

std::string_view name_of(StageFault fault) {
  static constexpr std::string_view names[] = {"error:20", "ALARM:1", "ALARM:2", "restart",   "lost steps",
                                               "no ok",    "garbage", "hang up", "cable lost"};
  static_assert(std::size(names) == kStageFaults);
  return names[static_cast<std::size_t>(fault)];
}

GrblModel::GrblModel(double top_mm, const Clock& clock, MachineLog* log, GrblBoard board)
    : top_mm_{top_mm}, clock_{clock}, log_{log}, board_{board}, lamp_{log}, gap_mm_{log != nullptr ? log->z_mm() : 0} {
  restart(clock_.now());
}

void GrblModel::plan_fault(StageFault fault, std::uint64_t lines_from_now) {
  fault_ = {fault, lines_ + lines_from_now};
}

Nanoseconds GrblModel::idle_at() const { return motions_.empty() ? at_ : std::max(at_, motions_.back().until); }

void GrblModel::answer(std::string text, Nanoseconds due) {
  // Answers keep the order of their lines.
  if (!outgoing_.empty()) due = std::max(due, outgoing_.back().due);
  outgoing_.push_back({due, std::move(text)});
}

void GrblModel::stop_motion(Nanoseconds at) {
  end_motions(at);
  if (!motions_.empty()) {
    const BoardMotion& m = motions_.front();
    const double share =
        m.until > m.from ? std::clamp(double((at - m.from).count()) / double((m.until - m.from).count()), 0.0, 1.0) : 1;
    gap_mm_ = m.from_mm + (m.to_mm - m.from_mm) * share;
    if (log_ != nullptr && at > m.from) log_->moved({m.from, at, m.from_mm, gap_mm_});
  }
  motions_.clear();
}

void GrblModel::restart(Nanoseconds at) {
  stop_motion(at);
  spindle_on_ = feeds_ = false;
  s_ = feed_mm_per_min_ = 0;
  lamp_.set(0, at);
  locked_ = true;
  frozen_at_.reset();
  incoming_.clear();
  lines_in_.clear();
  buffered_bytes_ = 0;
  outgoing_.clear();
  boots_until_ = at + kBoot;
  ready_at_ = boots_until_;
  answer(fmt::format("\r\nGrbl {} ['$' for help]\r\n[MSG:'$H'|'$X' to unlock]\r\n", board_.version), boots_until_);
}

void GrblModel::lock(std::string_view alarm) {
  stop_motion(at_);
  spindle_on_ = false;
  lamp_.set(0, at_);
  locked_ = true;
  answer(std::string{alarm} + "\r\n", at_);
}

void GrblModel::reopened() {
  tick();
  gone_ = false;
  restart(clock_.now());
}

void GrblModel::end_motions(Nanoseconds until) {
  while (!motions_.empty() && motions_.front().until <= until) {
    const BoardMotion m = motions_.front();
    motions_.pop_front();
    gap_mm_ = m.to_mm;
    if (m.homing) locked_ = false;
    if (log_ != nullptr) log_->moved({m.from, m.until, m.from_mm, m.to_mm});
  }
}

void GrblModel::tick() {
  const Nanoseconds now = clock_.now();
  while (!frozen_at_ && !lines_in_.empty()) {
    const Nanoseconds start = std::max(lines_in_.front().came, ready_at_);
    if (start > now) break;
    const std::string line = std::move(lines_in_.front().text);
    lines_in_.pop_front();
    buffered_bytes_ -= line.size() + 1;
    at_ = ready_at_ = start;
    end_motions(at_);
    execute(line);
  }
  at_ = now;
  end_motions(now);
}

void GrblModel::freeze() {
  if (ready_at_ <= clock_.now() || frozen_at_) return stop_motion(clock_.now());
  if (!motions_.empty()) return stop_motion(clock_.now());
  frozen_at_ = clock_.now();
  drive_lamp(clock_.now());
}

void GrblModel::thaw() {
  if (!frozen_at_) return;
  const Nanoseconds lost = clock_.now() - *std::exchange(frozen_at_, std::nullopt);
  ready_at_ += lost;
  for (Pending& p : outgoing_)
    if (p.due > clock_.now() - lost) p.due += lost;
  drive_lamp(clock_.now());
}

void GrblModel::take_byte(char c) {
  const Nanoseconds now = clock_.now();
  if (c == '\x18') return restart(now);
  if (now < boots_until_) return;  // lost
  if (c == '?') return status();
  if (c == '!') return freeze();
  if (c == '~') return thaw();
  if (buffered_bytes_ >= board_.buffer_bytes) {
    ++overflows_;
    return;
  }
  const bool is_end = c == '\n' || c == '\r';
  if (is_end && incoming_.empty()) return;
  ++buffered_bytes_;
  if (!is_end) return incoming_.push_back(c);
  lines_in_.push_back({now, std::exchange(incoming_, {})});
  tick();
}

bool GrblModel::receive(std::string_view bytes) {
  tick();
  for (const char c : bytes) {
    if (gone_) return false;
    take_byte(c);
  }
  return !gone_;
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
  const std::string_view state = frozen_at_ ? "Hold:0" : locked_ ? "Alarm" : motions_.empty() ? "Idle" : "Run";
  std::string text = fmt::format("<{}|MPos:0.000,0.000,{:.3f}", state, z);
  if ((board_.status_mask & 2) != 0) text += fmt::format("|Bf:15,{}", board_.buffer_bytes - buffered_bytes_);
  text += fmt::format("|FS:0,{:.0f}", lamp_.lit() ? s_ : 0);
  // Overrides and what is switched on are told after a change.
  if (std::exchange(report_accessories_, false)) text += lamp_.lit() ? "|Ov:100,100,100|A:S" : "|Ov:100,100,100";
  // A status is not queued behind other answers: it is sent from the interrupt.
  outgoing_.push_front({clock_.now(), text + ">\r\n"});
}

void GrblModel::queue_move(double to_mm, double mm_per_s, bool homing) {
  fab::queue_move(motions_, idle_at(), gap_mm_, to_mm, mm_per_s, homing, at_, acceleration_mm_per_s2_);
}

void GrblModel::acknowledge(Nanoseconds due) {
  ready_at_ = due;
  if (now_ != StageFault::NoOk) answer("ok\r\n", due);
}

void GrblModel::execute(std::string_view line) {
  const std::uint64_t n = lines_++;
  now_.reset();
  if (fault_ && fault_->second == n) now_ = std::exchange(fault_, {})->first;
  if (now_ == StageFault::ErrorLine) return answer("error:20\r\n", at_);
  if (now_ == StageFault::AlarmLost) return lock("ALARM:1");
  if (now_ == StageFault::AlarmLimit) return lock("ALARM:2");
  if (now_ == StageFault::Restart) return restart(at_);
  if (now_ == StageFault::HangUp) {
    restart(at_);
    gone_ = true;
    return;
  }
  if (now_ == StageFault::CableLost) gone_ = true;
  if (now_ == StageFault::Garbage) answer("\x7f\xfe~~#\r\n", at_);
  if (line.starts_with('$')) return system_command(line);
  if (locked_) return answer("error:9\r\n", at_);
  const Block block = Block::of(line);
  if (!block.error.empty()) return answer(std::string{block.error} + "\r\n", at_);
  carry_out(block);
}

void GrblModel::system_command(std::string_view line) {
  if (line == "$H") {
    queue_move(top_mm_, kHoming_mm_per_s, true);
    return acknowledge(idle_at());
  }
  if (line == "$X")
    locked_ = false;
  else if (line == "$#")
    answer("[G54:0.000,0.000,0.000]\r\n[PRB:0.000,0.000,0.000:0]\r\n", at_);
  else if (line == "$N")
    answer("$N0=\r\n$N1=\r\n", at_);
  else if (line == "$G")
    answer("[GC:G0 G54 G17 G21 G90 G94 M5 M9 T0 F0 S0]\r\n", at_);
  else if (line == "$I")
    answer(fmt::format("[VER:{}.20190825:]\r\n[OPT:{},15,{}]\r\n", board_.version, board_.variable_spindle ? "V" : "",
                       board_.buffer_bytes),
           at_);
  else if (line == "$$")
    answer(fmt::format("$10={}\r\n$22=1\r\n$30={:.3f}\r\n$31={:.3f}\r\n$32={}\r\n", board_.status_mask, board_.full_s,
                       board_.least_s, board_.laser_mode ? 1 : 0),
           at_);
  else
    return answer("error:3\r\n", at_);
  acknowledge(at_);
}

void GrblModel::carry_out(const Block& block) {
  const double feed = block.f.value_or(feed_mm_per_min_);
  if (block.g1 && feed <= 0) return answer("error:22\r\n", at_);
  if (block.g4 && !block.p) return answer("error:28\r\n", at_);
  if (!block.g4 && block.p) return answer("error:36\r\n", at_);
  if (block.z && !block.g1) return answer("error:31\r\n", at_);
  feed_mm_per_min_ = feed;
  feeds_ = feeds_ || block.g1;
  if (block.s) s_ = *block.s;
  if (block.spindle) spindle_on_ = *block.spindle;
  Nanoseconds until = at_;
  if (block.s || block.spindle) {
    until = idle_at();
    drive_lamp(until);
  }
  if (block.g4) until = idle_at() + dwell(*block.p);
  if (block.z && !move(block)) return;
  acknowledge(until);
}

void GrblModel::drive_lamp(Nanoseconds at) {
  const bool may_shine = !board_.laser_mode || (feeds_ && !frozen_at_);
  const double power = s_ <= 0 ? 0 : std::clamp(s_, board_.least_s, board_.full_s) / board_.full_s;
  lamp_.set(spindle_on_ && may_shine ? power : 0, at);
  report_accessories_ = true;
}

bool GrblModel::move(const Block& block) {
  if (!block.g53 || !block.g90 || !block.g21) {
    answer("error:33\r\n", at_);
    return false;
  }
  double to_mm = *block.z + kPullOff_mm + top_mm_;
  if (to_mm > top_mm_ + kPullOff_mm || to_mm < -1e-6) {
    lock("ALARM:2");
    return false;
  }
  if (now_ == StageFault::LostSteps) to_mm += kLostSteps_mm;
  queue_move(to_mm, std::min(feed_mm_per_min_, kFastest_mm_per_min) / 60, false);
  return true;
}

}  // namespace telefab::fab
