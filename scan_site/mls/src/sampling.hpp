// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <span>
#include <stop_token>
#include <telefab/base/result.hpp>
#include <vector>

#include "sample_grid.hpp"

namespace telefab::scan {

/// Local spacing s = r_12 sqrt(pi / 12) at a sample: r_12 is the distance to its twelfth neighbour whose normal does
/// not oppose its own. `guess` is where the search starts. Millimetres; the samples' extent where there are fewer.
[[nodiscard]] float local_spacing(const SampleGrid& grid, std::uint32_t sample, float guess);

struct Evenness {
  double spacing_mm = 0;  ///< median
  double unevenness = 1;  ///< 99 % over 1 %, each sample's spacing averaged over its neighbours
  bool rows = false;      ///< samples lie in rows, as line scanners take them: the spacing is then that of the rows
  double nearest = 1;     ///< median distance of the nearest other sample, in spacings: 1.07 on hexagons, .47 at random
};
/// From about a thousand samples spread over the grid.
[[nodiscard]] Evenness measure_evenness(const SampleGrid& grid, float guess);

/// Spacing of every sample, with `rows` that of the rows where it lies in some, averaged twice over neighbours within
/// two spacings. Parallel. Fails: Cancelled.
[[nodiscard]] Result<std::vector<float>> smooth_spacing(const SampleGrid& grid, float guess, bool rows,
                                                        std::stop_token stop);

/// A first idea of the spacing, from the box alone: right within a factor of a few.
[[nodiscard]] float spacing_from_box(std::span<const Eigen::Vector3f> points);

}  // namespace telefab::scan
