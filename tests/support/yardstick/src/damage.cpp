// SPDX-License-Identifier: GPL-3.0-or-later
#include <telefab/test/damage.hpp>

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <random>
#include <telefab/scan/cloud/kd_tree.hpp>

namespace telefab::test {
namespace {

double median_spacing(const scan::PointCloud& cloud) {
  const scan::KdTree near{cloud.points};
  std::vector<float> squares;
  for (std::size_t i = 0; i < cloud.size(); i += 7) {
    std::array<scan::Neighbour, 11> found;
    squares.push_back(found[near.nearest(cloud.points[i], found) - 1].squared_distance);
  }
  std::nth_element(squares.begin(), squares.begin() + static_cast<std::ptrdiff_t>(squares.size() / 2), squares.end());
  return std::sqrt(3.14159265 / 10 * static_cast<double>(squares[squares.size() / 2]));
}

}  // namespace

Result<Damage> Damage::named(std::string_view name, std::uint64_t seed) {
  Damage d;
  d.seed = seed;
  if (name == "whole") return d;
  if (name == "holes3") return d.hole_diagonals = 0.03, d;
  if (name == "holes5") return d.hole_diagonals = 0.05, d;
  if (name == "off3") return d.lowest_off = 0.03, d;
  if (name == "off10") return d.lowest_off = 0.1, d;
  if (name == "noise1") return d.noise_diagonals = 0.001, d;
  if (name == "noise2") return d.noise_diagonals = 0.002, d;
  if (name == "density10") return d.density = 10, d;
  if (name == "two") return d.shift_spacings = 0.5, d;
  if (name == "all") {
    d.hole_diagonals = 0.03;
    d.noise_diagonals = 0.001;
    d.density = 4;
    d.shift_spacings = 0.5;
    return d;
  }
  return fail(ErrorCode::InvalidInput,
              fmt::format("no damage named \"{}\"; there are whole, holes3, holes5, off3, off10, "
                          "noise1, noise2, density10, two, all",
                          name));
}

scan::PointCloud damaged(const scan::PointCloud& whole, const Damage& damage) {
  std::mt19937_64 random{damage.seed};
  std::normal_distribution<double> bell;
  std::uniform_real_distribution<double> even;
  Eigen::Vector3f low = whole.points[0], high = low;
  for (const auto& p : whole.points) low = low.cwiseMin(p), high = high.cwiseMax(p);
  const double diagonal = static_cast<double>((high - low).norm());
  const double spacing = median_spacing(whole);
  std::vector<Eigen::Vector3f> centres;
  if (damage.hole_diagonals > 0)
    for (int i = 0; i < 8; ++i) centres.push_back(whole.points[random() % whole.size()]);
  scan::PointCloud cloud;
  cloud.origin = whole.origin;
  const Eigen::Vector3d shift =
      damage.shift_spacings * spacing * Eigen::Vector3d{bell(random), bell(random), bell(random)}.normalized();
  for (std::size_t i = 0; i < whole.size(); ++i) {
    const Eigen::Vector3f& p = whole.points[i];
    const Eigen::Vector3d noise =
        damage.noise_diagonals * diagonal * Eigen::Vector3d{bell(random), bell(random), bell(random)};
    const double kept = std::pow(damage.density, -static_cast<double>((p.x() - low.x()) / (high.x() - low.x())));
    if (even(random) > kept) continue;
    if (static_cast<double>(p.z() - low.z()) < damage.lowest_off * static_cast<double>(high.z() - low.z())) continue;
    const double radius = damage.hole_diagonals * diagonal;
    if (std::any_of(centres.begin(), centres.end(),
                    [&](const auto& c) { return static_cast<double>((c - p).norm()) < radius; }))
      continue;
    Eigen::Vector3d moved = p.cast<double>() + noise;
    if (i % 2 == 1) moved += shift;
    cloud.points.push_back(moved.cast<float>());
    cloud.normals.push_back(whole.normals[i]);
  }
  return cloud;
}

}  // namespace telefab::test
