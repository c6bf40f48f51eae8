// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <algorithm>
#include <cmath>
#include <cstdint>
#include <numeric>
#include <span>
#include <telefab/scan/mls/scalar_field.hpp>
#include <vector>

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

/// Indices of the points, those of one cell of two kernels after each other, and cells in columns: a cursor that asks
/// in this order gathers little twice.
inline std::vector<std::uint32_t> by_cell(const ScalarField& field, std::span<const Vec3> points) {
  if (points.empty()) return {};
  const double size_mm = 2 * field.kernel_width_mm(points[points.size() / 2]);
  std::vector<std::uint64_t> keys;
  keys.reserve(points.size());
  for (const Vec3& p : points) keys.push_back(key_of(cell_of(p, size_mm)));
  std::vector<std::uint32_t> order(points.size());
  std::iota(order.begin(), order.end(), 0U);
  std::sort(order.begin(), order.end(),
            [&](std::uint32_t a, std::uint32_t b) { return keys[a] != keys[b] ? keys[a] < keys[b] : a < b; });
  return order;
}

}  // namespace telefab::scan::topology
