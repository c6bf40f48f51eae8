// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <Eigen/Geometry>
#include <cmath>
#include <numbers>
#include <random>
#include <string>
#include <vector>

namespace telefab::test {

/// A block of 8 x 8 x 10 mm whose faces are sampled on an exact grid, edges and corners once; turned about x, with
/// Gaussian noise. What coordinate machines give, and what marching planes pass through exactly.
struct GridBlock {
  double step_mm = 0.25;
  double turn_deg = 0;
  double noise_mm = 0;
};

[[nodiscard]] inline std::vector<Eigen::Vector3d> points_of(const GridBlock& block) {
  const Eigen::Vector3d size{8, 8, 10};
  std::mt19937_64 rng{static_cast<std::uint64_t>(1e6 * block.step_mm + 1e3 * block.turn_deg + 1e9 * block.noise_mm)};
  const auto uniform = [&] { return (static_cast<double>(rng() >> 11U) + 0.5) * 0x1p-53; };
  const auto normal = [&] {
    const double radius = std::sqrt(-2 * std::log(uniform()));
    return radius * std::cos(2 * std::numbers::pi * uniform());
  };
  const Eigen::AngleAxisd turn{block.turn_deg * std::numbers::pi / 180, Eigen::Vector3d::UnitX()};
  Eigen::Vector3i count;
  for (int a = 0; a < 3; ++a) count[a] = static_cast<int>(std::round(size[a] / block.step_mm));
  std::vector<Eigen::Vector3d> points;
  for (int i = 0; i <= count.x(); ++i)
    for (int j = 0; j <= count.y(); ++j)
      for (int k = 0; k <= count.z(); ++k) {
        if (i > 0 && i < count.x() && j > 0 && j < count.y() && k > 0 && k < count.z()) continue;
        Eigen::Vector3d p =
            Eigen::Vector3d{i * size.x() / count.x(), j * size.y() / count.y(), k * size.z() / count.z()};
        p = turn * p;
        if (block.noise_mm > 0) p += block.noise_mm * Eigen::Vector3d{normal(), normal(), normal()};
        points.push_back(p);
      }
  return points;
}

}  // namespace telefab::test
