// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <deque>
#include <telefab/base/clock.hpp>

namespace telefab::fab {

/// A move of a board's axis in its queue, for models of boards.
struct BoardMotion {
  Nanoseconds from{}, until{};
  double from_mm = 0, to_mm = 0;
  bool homing = false;
  double mm_per_s = 0;   ///< at most
  Nanoseconds queued{};  ///< when it came
};

/// A move that begins at `idle`, where the others have ended, and at `gap_mm` where there are none. With an
/// acceleration, 0 for none, moves that came at one time are planned as one path (walk).
void queue_move(std::deque<BoardMotion>& motions, Nanoseconds idle, double gap_mm, double to_mm, double mm_per_s,
                bool homing, Nanoseconds queued, double acceleration_mm_per_s2);

}  // namespace telefab::fab
