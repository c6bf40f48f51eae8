// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include "lever.hpp"

namespace telefab::fab {

/// A level section under what hangs together above it.
struct LevelStress {
  std::uint32_t section = 0;  ///< that bears most
  double stress = 0;          ///< at its rim, over the pull
  Pull pull;
};
/// Groups that hold at least some area, and others.
struct WorstLevels {
  std::vector<LevelStress> large, small;
};
/// Stresses that are of no interest any more.
struct LevelFloors {
  double large = 0, small = 0;
};

/// The level section that bears most below what hangs together at that moment, for each group of pieces until it meets
/// another: force over area and moment over second moment of area, as in beams. Only stresses above the floors.
[[nodiscard]] WorstLevels worst_levels(const LoadPath& path, std::uint32_t moment, double sideways_share,
                                       double least_held_mm2, const LevelFloors& floors);

}  // namespace telefab::fab
