// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <array>
#include <span>
#include <telefab/geometry/contour.hpp>
#include <vector>

namespace telefab::campaign {

using Segment = std::array<Point2, 2>;

[[nodiscard]] std::vector<Segment> segments_of(std::span<const Contour> contours);

/// Areas of two sections given by their outlines, in any order: of the second, and of what belongs to one of them
/// alone.
struct SectionAreas {
  double truth_mm2 = 0;
  double wrong_mm2 = 0;
};
/// By lines `pitch_mm` apart, exact along them; even crossings are outside.
[[nodiscard]] SectionAreas compare_sections(std::span<const Segment> found, std::span<const Segment> truth,
                                            double pitch_mm);

/// Places along the outlines, every `step_mm`.
[[nodiscard]] std::vector<Point2> along(std::span<const Segment> outlines, double step_mm);

}  // namespace telefab::campaign
