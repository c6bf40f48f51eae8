// SPDX-License-Identifier: GPL-3.0-or-later
#ifdef TELEFAB_TREE_AVX2
#include "tree_lanes.hpp"

namespace telefab::scan {

TreeSumSet avx2_tree_sums() { return {sum_lanes<false>, sum_lanes<true>}; }

}  // namespace telefab::scan
#endif
