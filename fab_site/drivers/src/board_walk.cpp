// SPDX-License-Identifier: GPL-3.0-or-later
#include "board_walk.hpp"

#include <algorithm>
#include <cmath>
#include <telefab/fab/drivers/board_motion.hpp>

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

void queue_move(std::deque<BoardMotion>& motions, Nanoseconds idle, double gap_mm, double to_mm, double mm_per_s,
                bool homing, Nanoseconds queued, double acceleration_mm_per_s2) {
  const double from_mm = motions.empty() ? gap_mm : motions.back().to_mm;
  const auto takes = Nanoseconds{static_cast<Nanoseconds::rep>(std::abs(to_mm - from_mm) / mm_per_s * 1e9)};
  motions.push_back({idle, idle + takes, from_mm, to_mm, homing, mm_per_s, queued});
  if (acceleration_mm_per_s2 <= 0) return;
  const auto first =
      std::find_if(motions.begin(), motions.end(), [&](const BoardMotion& m) { return m.queued == queued; });
  std::vector<BoardMove> moves;
  for (auto m = first; m != motions.end(); ++m) moves.push_back({m->to_mm, m->mm_per_s});
  const auto times = walk(first->from_mm, moves, acceleration_mm_per_s2);
  Nanoseconds at = first->from;
  for (std::size_t i = 0; i < times.size(); ++i) {
    BoardMotion& m = *(first + static_cast<std::ptrdiff_t>(i));
    m.from = at;
    m.until = at += times[i];
  }
}

}  // namespace telefab::fab
