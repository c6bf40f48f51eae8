// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <cstdint>
#include <optional>
#include <telefab/fab/device/machine_log.hpp>
#include <telefab/fab/device/z_stage.hpp>

namespace telefab::fab {

/// Ways a virtual stage can misbehave. Counts are of moves and homings since construction, from 0; empty: never.
struct StageFaults {
  std::optional<std::uint32_t> stall_at;  ///< this move never ends
  std::optional<std::uint32_t> lose_at;   ///< during this move the stage is gone until home()
  std::optional<std::uint32_t> alarm_at;  ///< this move answers DeviceRefused
  double lost_steps_mm = 0;               ///< every move ends short by this; noticed at rest
};

/// A stage that moves nothing and writes down how it would have: a product, chosen by `stage = "virtual"`. Strict:
/// refuses to move before homing, beyond its limits and while moving.
class VirtualZStage final : public ZStage {
 public:
  /// Travels from 0 to highest_mm; starts at an unknown place. The clock and the log must outlive the stage.
  VirtualZStage(double highest_mm, Clock& clock, MachineLog& log);

  [[nodiscard]] const StageFacts& facts() const override { return facts_; }
  [[nodiscard]] Result<void> home() override;
  [[nodiscard]] Result<void> move_to(double z_mm, double speed_mm_per_s) override;
  [[nodiscard]] Result<StageStatus> poll() override;
  [[nodiscard]] Result<void> hold() override;

  StageFaults faults;

 private:
  void start(double target_mm, double speed_mm_per_s);

  Clock& clock_;
  MachineLog& log_;
  StageFacts facts_;
  bool homed_ = false;
  bool homing_ = false;
  bool moving_ = false;
  double z_mm_ = 0;
  double target_mm_ = 0;
  Nanoseconds started_{};
  Nanoseconds ends_{};
  Nanoseconds deadline_{};
  bool stalled_ = false;
  bool gone_ = false;
  std::uint32_t moves_ = 0;
};

}  // namespace telefab::fab
