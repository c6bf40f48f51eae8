// SPDX-License-Identifier: GPL-3.0-or-later
#include <algorithm>
#include <cmath>
#include <telefab/fab/device/virtual_z_stage.hpp>

namespace telefab::fab {

namespace {

constexpr double kFastest_mm_per_s = 50;
constexpr double kHoming_mm_per_s = 20;

Nanoseconds duration_of(double distance_mm, double speed_mm_per_s) {
  return Nanoseconds{static_cast<Nanoseconds::rep>(std::abs(distance_mm) / speed_mm_per_s * 1e9)};
}

}  // namespace

VirtualZStage::VirtualZStage(double highest_mm, Clock& clock, MachineLog& log)
    : clock_{clock},
      log_{log},
      facts_{"virtual stage", 0, highest_mm, kFastest_mm_per_s, kHoming_mm_per_s, 0.002},
      z_mm_{log.z_mm()} {}

void VirtualZStage::start(double target_mm, double speed_mm_per_s) {
  const std::uint32_t call = moves_++;
  target_mm_ = target_mm;
  started_ = clock_.now();
  ends_ = started_ + duration_of(target_mm - z_mm_, speed_mm_per_s);
  deadline_ = started_ + move_deadline(target_mm - z_mm_, speed_mm_per_s);
  moving_ = true;
  stalled_ = faults.stall_at == call;
  gone_ = faults.lose_at == call;
}

Result<void> VirtualZStage::home() {
  if (moving_) (void)hold();
  homed_ = false;
  homing_ = true;
  start(facts_.highest_mm, facts_.homing_mm_per_s);
  return {};
}

Result<void> VirtualZStage::move_to(double z_mm, double speed_mm_per_s) {
  if (!(z_mm >= facts_.lowest_mm && z_mm <= facts_.highest_mm))
    return fail(ErrorCode::InvalidInput, "the target lies outside the stage's limits");
  if (!(speed_mm_per_s > 0 && speed_mm_per_s <= facts_.fastest_mm_per_s))
    return fail(ErrorCode::InvalidInput, "the speed is not positive or above the stage's fastest");
  if (!homed_) return fail(ErrorCode::Conflict, "the stage is not homed");
  if (moving_) return fail(ErrorCode::Conflict, "the stage is still moving");
  if (faults.alarm_at == moves_) {
    ++moves_;
    homed_ = false;
    return fail(ErrorCode::DeviceRefused, "virtual stage: alarm");
  }
  homing_ = false;
  start(z_mm, speed_mm_per_s);
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
  if (moving_ && !stalled_ && now >= ends_) {
    moving_ = false;
    const double reached = homing_ ? target_mm_ : target_mm_ - faults.lost_steps_mm;
    log_.moved({started_, ends_, z_mm_, reached});
    z_mm_ = reached;
    if (std::abs(reached - target_mm_) > facts_.steps_tolerance_mm) {
      homed_ = false;
      return fail(ErrorCode::DeviceRefused, "virtual stage: came to rest in the wrong place");
    }
    homed_ = true;
  }
  return StageStatus{moving_, homed_, z_mm_};
}

Result<void> VirtualZStage::hold() {
  if (moving_) {
    const Nanoseconds now = clock_.now();
    const double share =
        ends_ > started_ ? std::min(1.0, double((now - started_).count()) / double((ends_ - started_).count())) : 1;
    const double reached = stalled_ ? z_mm_ : z_mm_ + (target_mm_ - z_mm_) * share;
    log_.moved({started_, std::min(now, ends_), z_mm_, reached});
    z_mm_ = reached;
  }
  moving_ = homed_ = gone_ = false;
  return {};
}

}  // namespace telefab::fab
