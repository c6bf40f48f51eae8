// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <span>
#include <telefab/base/clock.hpp>
#include <vector>

namespace telefab::fab {

/// One stretch of a path of the platform: to that gap over the vat, at that speed.
struct StageLeg {
  double z_mm = 0;
  double speed_mm_per_s = 0;
  friend bool operator==(const StageLeg&, const StageLeg&) = default;
};

/// How long each leg takes from rest at from_mm to rest at the end of the last. Where two legs go one way the axis does
/// not rest between them: it passes at the slower speed, or as fast as it can by then. `acceleration_mm_per_s2` 0:
/// speeds are reached at once. Speeds are positive.
[[nodiscard]] std::vector<Nanoseconds> leg_times(double from_mm, std::span<const StageLeg> legs,
                                                 double acceleration_mm_per_s2);

/// Their sum.
[[nodiscard]] Nanoseconds path_time(double from_mm, std::span<const StageLeg> legs, double acceleration_mm_per_s2);

/// How long a path or a homing run may take before it counts as failed: twice its time and two seconds.
[[nodiscard]] Nanoseconds path_deadline(double from_mm, std::span<const StageLeg> legs, double acceleration_mm_per_s2);

}  // namespace telefab::fab
