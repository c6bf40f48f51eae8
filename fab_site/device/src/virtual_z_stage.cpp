// SPDX-License-Identifier: GPL-3.0-or-later
#include <algorithm>
#include <cmath>
#include <telefab/fab/device/virtual_z_stage.hpp>

namespace telefab::fab {

namespace {

constexpr double kFastest_mm_per_s = 50;
constexpr double kNoWay_mm = 1e-12;

}  // namespace

VirtualZStage::VirtualZStage(double highest_mm, Clock& clock, MachineLog& log, const VirtualStageOptions& options)
    : clock_{clock},
      log_{log},
      options_{options},
      facts_{"virtual stage", 0, highest_mm, kFastest_mm_per_s, options.homing_mm_per_s, 0.002, true},
      z_mm_{log.z_mm()} {}

void VirtualZStage::start(std::vector<Stretch> stretches, Nanoseconds deadline) {
  const std::uint32_t call = moves_++;
  started_ = clock_.now();
  stretches_ = std::move(stretches);
  deadline_ = started_ + deadline;
  moving_ = true;
  stalled_ = faults.stall_at == call;
  gone_ = faults.lose_at == call;
}

void VirtualZStage::start_path(std::span<const StageLeg> legs) {
  const auto times = leg_times(z_mm_, legs, options_.acceleration_mm_per_s2);
  std::vector<Stretch> stretches;
  Nanoseconds at = clock_.now();
  for (std::size_t i = 0; i < legs.size(); ++i) stretches.push_back({at += times[i], legs[i].z_mm});
  start(std::move(stretches), path_deadline(z_mm_, legs, options_.acceleration_mm_per_s2));
}

Result<void> VirtualZStage::home() {
  if (moving_) (void)hold();
  homed_ = false;
  homing_ = true;
  const StageLeg up{facts_.highest_mm, facts_.homing_mm_per_s};
  start_path({&up, 1});
  return {};
}

Result<void> VirtualZStage::check_ready() {
  if (!homed_) return fail(ErrorCode::Conflict, "the stage is not homed");
  if (moving_) return fail(ErrorCode::Conflict, "the stage is still moving");
  if (faults.alarm_at == moves_) {
    ++moves_;
    homed_ = false;
    return fail(ErrorCode::DeviceRefused, "virtual stage: alarm");
  }
  homing_ = false;
  return {};
}

Result<void> VirtualZStage::move_along(std::span<const StageLeg> legs) {
  if (legs.empty()) return fail(ErrorCode::InvalidInput, "the stage was sent nowhere");
  for (const StageLeg& leg : legs) {
    if (!(leg.z_mm >= facts_.lowest_mm && leg.z_mm <= facts_.highest_mm))
      return fail(ErrorCode::InvalidInput, "the target lies outside the stage's limits");
    if (!(leg.speed_mm_per_s > 0 && leg.speed_mm_per_s <= facts_.fastest_mm_per_s))
      return fail(ErrorCode::InvalidInput, "the speed is not positive or above the stage's fastest");
  }
  if (const auto ready = check_ready(); !ready) return ready;
  start_path(legs);
  return {};
}

Result<void> VirtualZStage::tilt(Nanoseconds duration) {
  if (duration <= Nanoseconds{}) return fail(ErrorCode::InvalidInput, "the time to tip the vat is not positive");
  if (const auto ready = check_ready(); !ready) return ready;
  start({{clock_.now() + duration, z_mm_}}, duration * 2 + std::chrono::seconds{2});
  return {};
}

Result<StageStatus> VirtualZStage::poll() {
  if (gone_) {
    homed_ = false;
    return fail(ErrorCode::DeviceLost, "virtual stage: gone");
  }
  const Nanoseconds now = clock_.now();
  if (moving_ && stalled_ && now >= deadline_) {
    moving_ = homed_ = false;
    return fail(ErrorCode::DeviceTimeout, "virtual stage: the move did not end in time");
  }
  if (moving_ && !stalled_ && now >= stretches_.back().ends) {
    moving_ = false;
    const double target_mm = stretches_.back().to_mm;
    const bool is_short = !homing_ && std::abs(target_mm - z_mm_) > kNoWay_mm;
    if (is_short) stretches_.back().to_mm -= faults.lost_steps_mm;
    write_down(now);
    if (std::abs(z_mm_ - target_mm) > facts_.steps_tolerance_mm) {
      homed_ = false;
      return fail(ErrorCode::DeviceRefused, "virtual stage: came to rest in the wrong place");
    }
    homed_ = true;
  }
  return StageStatus{moving_, homed_, z_mm_};
}

void VirtualZStage::write_down(Nanoseconds until) {
  Nanoseconds from = started_;
  for (const Stretch& s : stretches_) {
    if (until <= from) break;
    const double share =
        s.ends > from ? std::min(1.0, double((until - from).count()) / double((s.ends - from).count())) : 1;
    const double reached = z_mm_ + (s.to_mm - z_mm_) * share;
    log_.moved({from, std::min(until, s.ends), z_mm_, reached});
    z_mm_ = reached;
    from = s.ends;
  }
}

Result<void> VirtualZStage::hold() {
  if (moving_ && stalled_)
    log_.moved({started_, clock_.now(), z_mm_, z_mm_});
  else if (moving_)
    write_down(clock_.now());
  moving_ = homed_ = gone_ = false;
  return {};
}

}  // namespace telefab::fab
