// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <cmath>
#include <cstdint>
#include <telefab/scan/mls/scalar_field.hpp>

namespace telefab::scan::topology {

using Cell = Eigen::Vector3i;

/// Cell of a cubic grid through the origin. Coordinates far outside 2^20 cells wrap; neighbours stay neighbours.
inline Cell cell_of(const Vec3& p, double size_mm) { return (p / size_mm).array().floor().cast<int>(); }

inline std::uint64_t key_of(const Cell& c) {
  const auto part = [](int v) { return static_cast<std::uint64_t>(static_cast<std::uint32_t>(v)) & 0x1fffffu; };
  return part(c.x()) << 42 | part(c.y()) << 21 | part(c.z());
}

/// Calls visit(key) for the 27 cells around and of `c`, in fixed order.
template <class Visit>
void around(const Cell& c, Visit&& visit) {
  for (int dz = -1; dz <= 1; ++dz)
    for (int dy = -1; dy <= 1; ++dy)
      for (int dx = -1; dx <= 1; ++dx) visit(key_of(c + Cell(dx, dy, dz)));
}

}  // namespace telefab::scan::topology
