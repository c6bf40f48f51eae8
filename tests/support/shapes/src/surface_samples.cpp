// SPDX-License-Identifier: GPL-3.0-or-later
#include <telefab/test/surface_samples.hpp>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <random>
#include <unordered_map>

namespace telefab::test {
namespace {

using Cell = Eigen::Vector3i;

std::uint64_t key_of(const Cell& c) {
  const auto part = [](int v) { return static_cast<std::uint64_t>(v + (1 << 20)) & 0x1fffffu; };
  return part(c.x()) << 42 | part(c.y()) << 21 | part(c.z());
}

/// Cells of a cubic grid through which the surface passes: a corner inside and a corner outside.
std::vector<Cell> surface_cells(const AnalyticField& shape, const scan::Box3& box, double cell_mm) {
  const Cell n = ((box.max - box.min) / cell_mm).array().ceil().cast<int>() + 1;
  const std::size_t plane = static_cast<std::size_t>(n.x() + 1) * (n.y() + 1);
  std::vector<char> below(plane), above(plane);
  const auto fill = [&](std::vector<char>& row, int k) {
    for (int j = 0; j <= n.y(); ++j)
      for (int i = 0; i <= n.x(); ++i)
        row[static_cast<std::size_t>(j) * (n.x() + 1) + i] = shape.inside(box.min + cell_mm * Vec3(i, j, k));
  };
  std::vector<Cell> cells;
  fill(above, 0);
  for (int k = 0; k < n.z(); ++k) {
    below.swap(above);
    fill(above, k + 1);
    for (int j = 0; j < n.y(); ++j)
      for (int i = 0; i < n.x(); ++i) {
        const std::size_t a = static_cast<std::size_t>(j) * (n.x() + 1) + i;
        const std::size_t b = a + n.x() + 1;
        const int in =
            below[a] + below[a + 1] + below[b] + below[b + 1] + above[a] + above[a + 1] + above[b] + above[b + 1];
        if (in != 0 && in != 8) cells.emplace_back(i, j, k);
      }
  }
  return cells;
}

double uniform(std::mt19937_64& random) { return static_cast<double>(random() >> 11) * 0x1p-53; }
/// Box and Muller; the standard library's own normal distribution differs between libraries.
double gaussian(std::mt19937_64& random) {
  const double radius = std::sqrt(-2 * std::log(1 - uniform(random)));
  return radius * std::cos(6.283185307179586 * uniform(random));
}
Vec3 gaussian3(std::mt19937_64& random) {
  const double x = gaussian(random), y = gaussian(random), z = gaussian(random);
  return {x, y, z};
}

}  // namespace

SurfaceSamples sample_surface(const AnalyticField& shape, const SampleOptions& options) {
  // Thrown darts settle at about 0.61 points a squared least distance after so many rounds.
  constexpr double kDartDensity = 0.61;
  constexpr int kRounds = 14;
  const scan::Box3 box = shape.bounds();
  const double cell_mm = options.spacing_mm;
  const double least_mm = options.spacing_mm * std::sqrt(kDartDensity);
  const std::vector<Cell> cells = surface_cells(shape, box, cell_mm);

  std::mt19937_64 random{options.seed};
  std::unordered_map<std::uint64_t, std::vector<std::uint32_t>> taken;  // looked up, never iterated
  const double width_mm = box.max.x() - box.min.x();
  const auto least_at = [&](const Vec3& p) {
    return least_mm * (1 + (options.unevenness - 1) * (p.x() - box.min.x()) / width_mm);
  };
  const double bucket_mm = least_mm * options.unevenness;
  const auto cursor = shape.cursor();
  SurfaceSamples samples;
  for (int round = 0; round < kRounds; ++round)
    for (const Cell& cell : cells) {
      Vec3 p = box.min + cell_mm * (cell.cast<double>() + Vec3(uniform(random), uniform(random), uniform(random)));
      const Vec3 start = p;
      scan::FieldSample f = cursor->at(p);
      for (int i = 0; i < 12 && std::abs(f.value_mm) > 1e-10; ++i) {
        p -= f.value_mm / std::max(f.gradient.squaredNorm(), 0.25) * f.gradient;
        f = cursor->at(p);
      }
      if (std::abs(f.value_mm) > 1e-9 || (p - start).norm() > 3 * cell_mm) continue;
      if (std::any_of(options.holes.begin(), options.holes.end(),
                      [&](const Hole& h) { return (p - h.centre_mm).norm() < h.radius_mm; }))
        continue;
      const Cell at = ((p - box.min) / bucket_mm).array().floor().cast<int>();
      const double least = least_at(p);
      bool free = true;
      for (int dz = -1; dz <= 1 && free; ++dz)
        for (int dy = -1; dy <= 1 && free; ++dy)
          for (int dx = -1; dx <= 1 && free; ++dx) {
            const auto found = taken.find(key_of(at + Cell(dx, dy, dz)));
            if (found == taken.end()) continue;
            for (const std::uint32_t other : found->second)
              // Two sides of a thin wall do not crowd each other.
              if ((samples.points[other] - p).squaredNorm() < least * least &&
                  samples.normals[other].dot(f.gradient) > 0)
                free = false;
          }
      if (!free) continue;
      taken[key_of(at)].push_back(static_cast<std::uint32_t>(samples.points.size()));
      samples.points.push_back(p);
      samples.normals.push_back(f.gradient.normalized());
    }
  samples.area_mm2 = static_cast<double>(samples.points.size()) * options.spacing_mm * options.spacing_mm;

  for (std::size_t i = 0; i < samples.points.size(); ++i) {
    if (options.noise_mm > 0) samples.points[i] += options.noise_mm * gaussian3(random);
    if (options.normal_noise_rad > 0)
      samples.normals[i] = (samples.normals[i] + options.normal_noise_rad * gaussian3(random)).normalized();
  }
  const auto outliers = static_cast<std::size_t>(options.outlier_share * static_cast<double>(samples.points.size()));
  for (std::size_t i = 0; i < outliers; ++i) {
    const Vec3 share{uniform(random), uniform(random), uniform(random)};
    samples.points.push_back(box.min + share.cwiseProduct(box.max - box.min));
    samples.normals.push_back(gaussian3(random).normalized());
  }
  return samples;
}

}  // namespace telefab::test
