// SPDX-License-Identifier: GPL-3.0-or-later
#include "reconstruction.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <telefab/geometry/contour.hpp>
#include <telefab/test/mesh_truth.hpp>
#include <telefab/test/poisson.hpp>

namespace telefab::bench {

Result<void> reconstruct_and_cut(const std::filesystem::path& scan, int depth, std::size_t layers) {
  const auto file = test::read_faces(scan);
  if (!file) return tl::unexpected{file.error()};
  const auto mesh = test::poisson_faces(file->cloud, depth);
  if (!mesh) return tl::unexpected{mesh.error()};
  double low = 1e300, high = -1e300;
  for (const auto& p : mesh->corners) {
    low = std::min(low, p.z());
    high = std::max(high, p.z());
  }
  const double thickness = (high - low) / static_cast<double>(layers);
  std::vector<std::vector<std::array<Point2, 2>>> cut(layers);
  for (const auto& face : mesh->faces) {
    std::array<test::Vec3, 3> p{mesh->corners[face[0]], mesh->corners[face[1]], mesh->corners[face[2]]};
    std::sort(p.begin(), p.end(), [](const auto& a, const auto& b) { return a.z() < b.z(); });
    const auto first = static_cast<std::ptrdiff_t>(std::ceil((p[0].z() - low) / thickness - 0.5));
    for (std::ptrdiff_t k = std::max<std::ptrdiff_t>(0, first); k < static_cast<std::ptrdiff_t>(layers); ++k) {
      const double z = low + (static_cast<double>(k) + 0.5) * thickness;
      if (z >= p[2].z()) break;
      const auto on = [&](const test::Vec3& a, const test::Vec3& b) {
        const test::Vec3 q = a + (z - a.z()) / (b.z() - a.z()) * (b - a);
        return Point2{q.x(), q.y()};
      };
      cut[static_cast<std::size_t>(k)].push_back({on(p[0], p[2]), z < p[1].z() ? on(p[0], p[1]) : on(p[1], p[2])});
    }
  }
  std::size_t segments = 0;
  for (const auto& layer : cut) segments += layer.size();
  fmt::print("{} faces, {} segments\n", mesh->faces.size(), segments);
  return {};
}

}  // namespace telefab::bench
