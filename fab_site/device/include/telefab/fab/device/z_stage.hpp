// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <span>
#include <string>
#include <telefab/base/clock.hpp>
#include <telefab/base/result.hpp>
#include <telefab/fab/device/stage_path.hpp>

namespace telefab::fab {

/// What the stage is; read once after construction.
struct StageFacts {
  std::string name;
  double lowest_mm = 0;               ///< soft limit: smallest gap
  double highest_mm = 0;              ///< soft limit: largest gap, where homing ends
  double fastest_mm_per_s = 0;        ///< a faster move is refused
  double homing_mm_per_s = 0;         ///< slowest part of a homing run; for deadlines
  double steps_tolerance_mm = 0.002;  ///< at rest within this of the target
  bool tilts = false;                 ///< the vat tips
};

struct StageStatus {
  bool moving = false;
  bool homed = false;  ///< position is known
  double z_mm = 0;     ///< meaningful when homed and not moving
};

/// The platform's axis. z is the gap between platform and vat in millimetres: 0 touches the vat, up is positive.
/// Homing goes up and away from the vat, so it never presses a part into it. Threads: one caller at a time. Every call
/// is bounded in time: moves are started and then polled.
class ZStage {
 public:
  virtual ~ZStage() = default;
  ZStage(const ZStage&) = delete;
  ZStage& operator=(const ZStage&) = delete;

  [[nodiscard]] virtual const StageFacts& facts() const = 0;
  /// Starts to find the upper end; afterwards the position is facts().highest_mm.
  [[nodiscard]] virtual Result<void> home() = 0;
  /// Starts a move along one or more legs, without rest between those that go one way. InvalidInput without a leg, and
  /// for one that ends outside the soft limits or has a speed that is not positive, above the fastest or not finite;
  /// Conflict when not homed or still moving.
  [[nodiscard]] virtual Result<void> move_along(std::span<const StageLeg> legs) = 0;
  [[nodiscard]] Result<void> move_to(double z_mm, double speed_mm_per_s) {
    const StageLeg leg{z_mm, speed_mm_per_s};
    return move_along({&leg, 1});
  }
  /// Starts to tip the vat down and up again, over in that time; the platform keeps its place. InvalidInput where no
  /// vat tips or the time is not positive; Conflict when not homed or still moving.
  [[nodiscard]] virtual Result<void> tilt(Nanoseconds duration) = 0;
  /// Fails with Device* when the stage is lost, alarmed, late beyond its deadline or at rest in the wrong place; the
  /// position is then unknown until the next home().
  [[nodiscard]] virtual Result<StageStatus> poll() = 0;
  /// Stops now and holds; the position is unknown until the next home().
  [[nodiscard]] virtual Result<void> hold() = 0;

 protected:
  ZStage() = default;
};

}  // namespace telefab::fab
