// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <cmath>
#include <cstddef>

#include "tree_sums.hpp"

// The sums over a list for eight places, written once for every instruction set. Include it in tree_sums_*.cpp only.
namespace telefab::scan {
namespace {

using Lanes = float __attribute__((vector_size(4 * kTreeLanes)));

// Macros of the compiler's vector type would warn about calling conventions: everything stays inside one function.
template <bool kWide>
void sum_lanes(const TreeList& list, const TreePlaces& at, TreeSums& to) {
  Lanes qx, qy, qz;
  __builtin_memcpy(&qx, at.x, sizeof qx);
  __builtin_memcpy(&qy, at.y, sizeof qy);
  __builtin_memcpy(&qz, at.z, sizeof qz);
  Lanes winding = qx * 0.F;
  Lanes weight = winding, plane = winding, nx = winding, ny = winding, nz = winding, px = winding, py = winding,
        pz = winding;
  for (std::size_t i = 0; i < list.sample_count; ++i) {
    const TreeSample& s = list.samples[i];
    const Lanes x = s.x - qx, y = s.y - qy, z = s.z - qz;
    const Lanes r2 = x * x + y * y + z * z;
    const Lanes facing = s.nx * x + s.ny * y + s.nz * z;
    const Lanes soft = r2 + 0.25F * s.area;
    Lanes root;
    for (std::size_t l = 0; l < kTreeLanes; ++l) root[l] = __builtin_sqrtf(soft[l]);
    winding += facing / (soft * root);
    if constexpr (kWide) {
      const Lanes near = r2 + s.area;
      const Lanes k = 1.F / (near * near * near);
      const Lanes w = s.area * k;
      weight += w;
      plane -= k * facing;
      nx += k * s.nx;
      ny += k * s.ny;
      nz += k * s.nz;
      px += w * x;
      py += w * y;
      pz += w * z;
    }
  }
  for (std::size_t i = 0; i < list.node_count; ++i) {
    const TreeMoments& m = *list.nodes[i];
    const Lanes x = (m.x - at.origin[0]) - qx, y = (m.y - at.origin[1]) - qy, z = (m.z - at.origin[2]) - qz;
    const Lanes r2 = x * x + y * y + z * z;
    const Lanes facing = m.nx * x + m.ny * y + m.nz * z;
    // The first moment times the way there.
    const Lanes mx = m.xx * x + m.xy * y + m.xz * z;
    const Lanes my = m.xy * x + m.yy * y + m.yz * z;
    const Lanes mz = m.xz * x + m.yz * y + m.zz * z;
    const Lanes bent = x * mx + y * my + z * mz;
    const float trace = m.xx + m.yy + m.zz;
    const Lanes soft = r2 + 0.25F * m.soft;
    Lanes root;
    for (std::size_t l = 0; l < kTreeLanes; ++l) root[l] = __builtin_sqrtf(soft[l]);
    const Lanes inverse = 1.F / (soft * root);
    winding += inverse * (facing + trace - 3.F * bent / soft);
    if constexpr (kWide) {
      const Lanes near = 1.F / (r2 + m.soft);
      // What the samples' scatter adds to a sixth power: 6 * 5 / 6 of its mean square.
      const Lanes k = near * near * near * (1.F + 5.F * m.scatter * near);
      const Lanes w = m.area * k;
      const Lanes falling = 6.F * near;
      weight += w;
      plane -= k * (facing + trace - falling * bent);
      nx += k * (m.nx - falling * mx);
      ny += k * (m.ny - falling * my);
      nz += k * (m.nz - falling * mz);
      px += w * x;
      py += w * y;
      pz += w * z;
    }
  }
  const auto put = [](const Lanes& from, float* out) { __builtin_memcpy(out, &from, sizeof from); };
  put(winding, to.winding);
  if constexpr (kWide) {
    put(weight, to.weight);
    put(plane, to.plane);
    put(nx, to.nx);
    put(ny, to.ny);
    put(nz, to.nz);
    put(px, to.px);
    put(py, to.py);
    put(pz, to.pz);
  }
}

}  // namespace
}  // namespace telefab::scan
