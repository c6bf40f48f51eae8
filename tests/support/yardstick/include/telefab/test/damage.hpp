// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <cstdint>
#include <string>
#include <string_view>
#include <telefab/base/result.hpp>
#include <telefab/scan/cloud/point_cloud.hpp>

namespace telefab::test {

/// How a complete cloud becomes one that a scanner might give. Shares are of 1.
struct Damage {
  double hole_diagonals = 0;   ///< radius of eight holes about random samples
  double lowest_off = 0;       ///< share of the height without samples
  double noise_diagonals = 0;  ///< Gaussian sigma, all directions
  double density = 1;          ///< falls by this factor from one end of x to the other
  double shift_spacings = 0;   ///< every other sample belongs to a second scan, off by this much
  std::uint64_t seed = 1;

  /// "whole", "holes3", "holes5", "off3", "off10", "noise1", "noise2" (in .1 % of the diagonal), "density10",
  /// "two", "all" (holes3, noise1, density 4, two). Fails: InvalidInput lists them.
  [[nodiscard]] static Result<Damage> named(std::string_view name, std::uint64_t seed);
};

[[nodiscard]] scan::PointCloud damaged(const scan::PointCloud& whole, const Damage& damage);

}  // namespace telefab::test
