// SPDX-License-Identifier: GPL-3.0-or-later
#include "board_walk.hpp"

#include <algorithm>
#include <cmath>

namespace telefab::fab {

namespace {

constexpr double kStep_s = 1e-3;
constexpr double kThere_mm = 1e-6;

/// Fastest at the end of move i that lets all behind it be driven.
double passing_speed(double at_mm, std::span<const BoardMove> moves, std::size_t i, double acceleration) {
  if (i + 1 >= moves.size()) return 0;
  const double here = moves[i].to_mm - at_mm, next = moves[i + 1].to_mm - moves[i].to_mm;
  if (here * next <= 0) return 0;
  const double behind = passing_speed(moves[i].to_mm, moves, i + 1, acceleration);
  return std::min({moves[i].most_mm_per_s, moves[i + 1].most_mm_per_s,
                   std::sqrt(behind * behind + 2 * acceleration * std::abs(next))});
}

}  // namespace

std::vector<Nanoseconds> walk(double from_mm, std::span<const BoardMove> moves, double acceleration) {
  std::vector<Nanoseconds> times;
  double speed = 0;
  for (std::size_t i = 0; i < moves.size(); ++i) {
    double left_mm = std::abs(moves[i].to_mm - from_mm), seconds = 0;
    const double end = passing_speed(from_mm, moves, i, acceleration);
    while (left_mm > kThere_mm) {
      const double may = std::sqrt(end * end + 2 * acceleration * left_mm);  // and still brake to `end`
      const double wanted = std::min({speed + acceleration * kStep_s, moves[i].most_mm_per_s, may});
      const double mean = std::max((speed + wanted) / 2, acceleration * kStep_s / 2);
      const double step_s = std::min(kStep_s, left_mm / mean);
      left_mm -= mean * step_s;
      seconds += step_s;
      speed = wanted;
    }
    speed = std::min(speed, end);
    times.push_back(Nanoseconds{static_cast<Nanoseconds::rep>(seconds * 1e9)});
    from_mm = moves[i].to_mm;
  }
  return times;
}

}  // namespace telefab::fab
