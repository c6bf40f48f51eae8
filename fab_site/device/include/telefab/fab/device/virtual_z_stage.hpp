// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <cstdint>
#include <optional>
#include <telefab/fab/device/machine_log.hpp>
#include <telefab/fab/device/z_stage.hpp>
#include <vector>

namespace telefab::fab {

/// Ways a virtual stage can misbehave. Counts are of moves, tilts and homings since construction, from 0; empty: never.
struct StageFaults {
  std::optional<std::uint32_t> stall_at;  ///< this move never ends
  std::optional<std::uint32_t> lose_at;   ///< during this move the stage is gone until home()
  std::optional<std::uint32_t> alarm_at;  ///< this move answers DeviceRefused
  double lost_steps_mm = 0;               ///< every move ends short by this; noticed at rest
};

/// What a virtual stage is like.
struct VirtualStageOptions {
  double homing_mm_per_s = 20;
  double acceleration_mm_per_s2 = 0;  ///< 0: speeds are reached at once
};

/// A stage that moves nothing and writes down how it would have: a product, chosen by `stage = "virtual"`. Strict:
/// refuses to move before homing, beyond its limits and while moving.
class VirtualZStage final : public ZStage {
 public:
  /// Travels from 0 to highest_mm; starts at an unknown place. The clock and the log must outlive the stage.
  VirtualZStage(double highest_mm, Clock& clock, MachineLog& log, const VirtualStageOptions& options = {});

  [[nodiscard]] const StageFacts& facts() const override { return facts_; }
  [[nodiscard]] Result<void> home() override;
  [[nodiscard]] Result<void> move_along(std::span<const StageLeg> legs) override;
  [[nodiscard]] Result<void> tilt(Nanoseconds duration) override;
  [[nodiscard]] Result<StageStatus> poll() override;
  [[nodiscard]] Result<void> hold() override;

  StageFaults faults;

 private:
  /// A stretch under way, as the recorder will write it down.
  struct Stretch {
    Nanoseconds ends{};
    double to_mm = 0;
  };
  void start(std::vector<Stretch> stretches, Nanoseconds deadline);
  void start_path(std::span<const StageLeg> legs);
  /// Up to that time; the place reached.
  void write_down(Nanoseconds until);
  [[nodiscard]] Result<void> check_ready();

  Clock& clock_;
  MachineLog& log_;
  VirtualStageOptions options_;
  StageFacts facts_;
  bool homed_ = false;
  bool homing_ = false;
  bool moving_ = false;
  double z_mm_ = 0;
  Nanoseconds started_{};
  std::vector<Stretch> stretches_;
  Nanoseconds deadline_{};
  bool stalled_ = false;
  bool gone_ = false;
  std::uint32_t moves_ = 0;
};

}  // namespace telefab::fab
