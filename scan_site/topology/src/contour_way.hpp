// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <stop_token>

#include "ring.hpp"
#include "steepest_line.hpp"

namespace telefab::scan::topology {

/// How a contour was followed from height to height: along one steepest line, or where that was lost, along another
/// from elsewhere on the same contour.
struct ContourWay {
  explicit ContourWay(SteepestLine line) : path_mm{std::move(line.path_mm)}, end{line.end} {}

  std::vector<Vec3> path_mm;       ///< strictly monotone in z; over a loss it leaps within the contour
  std::optional<std::size_t> end;  ///< critical point reached, also the path's last point
  std::vector<Vec3> losses_mm;     ///< where a line was lost and another took over
};

/// Goes on where `way` was lost, if the contour does. False: it has an end, or nothing leads on from anywhere on it.
[[nodiscard]] bool go_on_elsewhere(const ScalarField& field, FieldCursor& cursor, const CriticalIndex& index,
                                   bool ascending, ContourWay& way, std::stop_token stop);

}  // namespace telefab::scan::topology
