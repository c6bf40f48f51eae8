// SPDX-License-Identifier: GPL-3.0-or-later
#include <algorithm>
#include <cmath>
#include <numeric>
#include <telefab/fab/device/stage_path.hpp>

namespace telefab::fab {

namespace {

Nanoseconds nanoseconds(double seconds) { return Nanoseconds{static_cast<Nanoseconds::rep>(seconds * 1e9)}; }

/// From one speed to another over a way, no faster than `most`; both can be had on it.
double seconds_over(double way_mm, double from, double to, double most, double acceleration) {
  const double ramps_mm = (2 * most * most - from * from - to * to) / (2 * acceleration);
  if (ramps_mm <= way_mm) return (2 * most - from - to) / acceleration + (way_mm - ramps_mm) / most;
  const double peak = std::sqrt((2 * acceleration * way_mm + from * from + to * to) / 2);
  return (2 * peak - from - to) / acceleration;
}

}  // namespace

std::vector<Nanoseconds> leg_times(double from_mm, std::span<const StageLeg> legs, double acceleration_mm_per_s2) {
  std::vector<double> way(legs.size());
  for (std::size_t i = 0; i < legs.size(); ++i) way[i] = legs[i].z_mm - (i == 0 ? from_mm : legs[i - 1].z_mm);
  std::vector<Nanoseconds> times(legs.size());
  if (acceleration_mm_per_s2 <= 0) {
    for (std::size_t i = 0; i < legs.size(); ++i) times[i] = nanoseconds(std::abs(way[i]) / legs[i].speed_mm_per_s);
    return times;
  }
  // Speeds at the ends of the legs: what the speeds allow, then what braking before and speeding up behind allow.
  std::vector<double> pass(legs.size() + 1, 0);
  for (std::size_t i = 0; i + 1 < legs.size(); ++i)
    if (way[i] * way[i + 1] > 0) pass[i + 1] = std::min(legs[i].speed_mm_per_s, legs[i + 1].speed_mm_per_s);
  const auto reach = [&](double speed, double way_mm) {
    return std::sqrt(speed * speed + 2 * acceleration_mm_per_s2 * std::abs(way_mm));
  };
  for (std::size_t i = legs.size(); i-- > 0;) pass[i] = std::min(pass[i], reach(pass[i + 1], way[i]));
  for (std::size_t i = 0; i < legs.size(); ++i) pass[i + 1] = std::min(pass[i + 1], reach(pass[i], way[i]));
  for (std::size_t i = 0; i < legs.size(); ++i)
    times[i] = nanoseconds(
        seconds_over(std::abs(way[i]), pass[i], pass[i + 1], legs[i].speed_mm_per_s, acceleration_mm_per_s2));
  return times;
}

Nanoseconds path_time(double from_mm, std::span<const StageLeg> legs, double acceleration_mm_per_s2) {
  const auto times = leg_times(from_mm, legs, acceleration_mm_per_s2);
  return std::accumulate(times.begin(), times.end(), Nanoseconds{});
}

Nanoseconds path_deadline(double from_mm, std::span<const StageLeg> legs, double acceleration_mm_per_s2) {
  constexpr Nanoseconds kGrace = std::chrono::seconds{2};
  return path_time(from_mm, legs, acceleration_mm_per_s2) * 2 + kGrace;
}

}  // namespace telefab::fab
