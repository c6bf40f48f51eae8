// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <optional>
#include <stop_token>
#include <telefab/scan/registration/register_views.hpp>

namespace telefab::scan {

struct Table {
  Vec3 up = Vec3::UnitY();  ///< unit: the axis of the turn; frame of the scanner
  std::size_t points = 0;   ///< taken out
};

/// Takes the table out of the views of a turn: the plane that stays where it is while what stands on it turns, seen
/// from above and reaching out beyond all else. Everything down from it goes. For views whose scanner stood still,
/// before their poses are known; the table would be the largest thing that matches at a wrong axis. Nothing: no table
/// found.
[[nodiscard]] std::optional<Table> remove_table(std::span<RangeImage> views, const std::stop_token& stop);

/// Takes out what is lower than `height` above the lowest point along `up` (unit): a stand, a clamp. Frame of view 0,
/// unit of the files. Returns how many points that were.
std::size_t cut_below(std::span<RangeImage> views, const Registration& turn, const Vec3& up, double height);

/// Of an axis' two senses the one nearer to the rows' upward direction: scanners stand upright.
[[nodiscard]] Vec3 up_of(const TurntableAxis& axis);

}  // namespace telefab::scan
