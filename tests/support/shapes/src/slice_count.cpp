// SPDX-License-Identifier: GPL-3.0-or-later
#include <cmath>
#include <cstdint>
#include <telefab/base/disjoint_sets.hpp>
#include <telefab/test/analytic_field.hpp>

namespace telefab::test {
SliceCount count_slice(const AnalyticField& shape, double z_mm, double pitch_mm) {
  return count_slice(
      shape.bounds(), [&](const Vec3& p) { return shape.inside(p); }, z_mm, pitch_mm);
}

SliceCount count_slice(const scan::Box3& box, const std::function<bool(const Vec3& place_mm)>& inside, double z_mm,
                       double pitch_mm) {
  const auto nx = static_cast<std::uint32_t>(std::ceil((box.max.x() - box.min.x()) / pitch_mm)) + 3;
  const auto ny = static_cast<std::uint32_t>(std::ceil((box.max.y() - box.min.y()) / pitch_mm)) + 3;
  std::vector<char> solid(static_cast<std::size_t>(nx) * ny, 0);
  for (std::uint32_t j = 1; j + 1 < ny; ++j)
    for (std::uint32_t i = 1; i + 1 < nx; ++i)
      solid[j * nx + i] = inside({box.min.x() + (i - 0.613) * pitch_mm, box.min.y() + (j - 0.387) * pitch_mm, z_mm});

  // Solid joins over edges, air over edges and corners: the parts of the air but one are the holes.
  DisjointSets parts{solid.size()};
  for (std::uint32_t j = 0; j < ny; ++j)
    for (std::uint32_t i = 0; i < nx; ++i) {
      const std::uint32_t a = j * nx + i;
      if (i + 1 < nx && solid[a] == solid[a + 1]) parts.join(a, a + 1);
      if (j + 1 < ny && solid[a] == solid[a + nx]) parts.join(a, a + nx);
      if (j + 1 < ny && !solid[a]) {
        if (i + 1 < nx && !solid[a + nx + 1]) parts.join(a, a + nx + 1);
        if (i > 0 && !solid[a + nx - 1]) parts.join(a, a + nx - 1);
      }
    }
  SliceCount count;
  for (std::uint32_t a = 0; a < solid.size(); ++a)
    if (parts.root(a) == a) ++(solid[a] ? count.outers : count.holes);
  --count.holes;
  return count;
}

}  // namespace telefab::test
