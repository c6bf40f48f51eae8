// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <cstddef>
#include <optional>
#include <span>
#include <telefab/scan/registration/align.hpp>
#include <telefab/scan/registration/range_image.hpp>

namespace telefab::scan {

/// How points stand to what range images saw in their direction.
struct FreeSpace {
  std::size_t judged = 0;       ///< points in front of or behind a whole patch of a view
  std::size_t conflicting = 0;  ///< of them, clearly in front of the patch: the view saw through them

  /// Share of the points that conflict; nothing where too few were judged to say so.
  [[nodiscard]] std::optional<double> conflict() const;
  FreeSpace& operator+=(const FreeSpace& other);
};

/// Holds every `step`-th point against what `judge` saw. A view without a parallel projection judges nothing. Points
/// of weight 0.2 or less do not count; no weights: all count.
[[nodiscard]] FreeSpace judge_points(std::span<const Eigen::Vector3f> points, std::span<const float> weights,
                                     std::size_t step, const RigidMotion& points_to_judge, const RangeImage& judge,
                                     double clearance);

}  // namespace telefab::scan
