// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <cstddef>

// Seen by the files compiled for special instruction sets: no header with inline code of ours or Eigen's in here.
namespace telefab::scan {

inline constexpr std::size_t kTreeLanes = 8;

/// A sample relative to the origin of a block; its normal times its area. Units of the tree.
struct TreeSample {
  float x, y, z;
  float area;
  float nx, ny, nz;
};

/// Samples seen from afar: centroid, area, sum of a n, symmetric part of sum a n (p - c)^T.
struct TreeMoments {
  float x, y, z;
  float area;
  float nx, ny, nz;
  float xx, xy, xz, yy, yz, zz;
  float soft;     ///< mean area of its samples
  float scatter;  ///< mean square of their distance from the centroid
};

struct TreeList {
  const TreeSample* samples;
  std::size_t sample_count;
  const TreeMoments* const* nodes;
  std::size_t node_count;
};

/// Eight places relative to the origin of their block.
struct TreePlaces {
  float origin[3];
  float x[kTreeLanes];
  float y[kTreeLanes];
  float z[kTreeLanes];
};

struct TreeSums {
  float winding[kTreeLanes];  ///< times 4 pi
  float weight[kTreeLanes];
  float plane[kTreeLanes];
  float nx[kTreeLanes], ny[kTreeLanes], nz[kTreeLanes];
  float px[kTreeLanes], py[kTreeLanes], pz[kTreeLanes];
};

using TreeSumFunction = void (*)(const TreeList& list, const TreePlaces& at, TreeSums& to);
struct TreeSumSet {
  TreeSumFunction winding;
  TreeSumFunction wide;
};

[[nodiscard]] TreeSumSet baseline_tree_sums();
#ifdef TELEFAB_TREE_AVX2
[[nodiscard]] TreeSumSet avx2_tree_sums();
#endif
/// The fastest version this machine can run; all give the same bytes.
[[nodiscard]] TreeSumSet fastest_tree_sums();

}  // namespace telefab::scan
