// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <cstddef>
#include <telefab/geometry/layer.hpp>

namespace telefab::scan {

/// Rings that are too small to be printed.
struct SpeckRule {
  double least_mm2 = 0;    ///< >= 0; of less area
  double thinnest_mm = 0;  ///< >= 0; thinner in the mean: twice the area over the length
};

struct LeftOut {
  std::size_t rings = 0;
  double largest_mm2 = 0;  ///< area of one of them
};

/// Takes the specks out of a layer, and with a speck what lies inside of it: nesting stays right. The certificate says
/// how many they were, and is one of a measured layer where nothing completed is left; what was found to be wrong with
/// the layer stays. The rings that remain have an area of at least `thinnest_mm` times half their length, so that none
/// of them is lost on a lattice whose points are less than half as far apart.
LeftOut leave_specks_out(Layer& layer, const SpeckRule& rule);

}  // namespace telefab::scan
