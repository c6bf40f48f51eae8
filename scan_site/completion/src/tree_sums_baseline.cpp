// SPDX-License-Identifier: GPL-3.0-or-later
#include "tree_lanes.hpp"

namespace telefab::scan {

TreeSumSet baseline_tree_sums() { return {sum_lanes<false>, sum_lanes<true>}; }

TreeSumSet fastest_tree_sums() {
#ifdef TELEFAB_TREE_AVX2
  if (__builtin_cpu_supports("avx2")) return avx2_tree_sums();
#endif
  return baseline_tree_sums();
}

}  // namespace telefab::scan
