// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <span>
#include <telefab/base/clock.hpp>
#include <vector>

namespace telefab::fab {

struct BoardMove {
  double to_mm = 0;
  double most_mm_per_s = 0;
};

/// How long each of moves that a board was given at once takes, walked in steps of a millisecond: it speeds up while it
/// may and brakes in time for the next corner. For models of boards; estimates have a formula of their own.
[[nodiscard]] std::vector<Nanoseconds> walk(double from_mm, std::span<const BoardMove> moves,
                                            double acceleration_mm_per_s2);

}  // namespace telefab::fab
