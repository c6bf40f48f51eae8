// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <telefab/fab/cure/edge_error.hpp>

#include "ring_index.hpp"

namespace telefab::fab {

/// Adds target, cured, excess, missing and far areas, counted on sub-pixels.
void add_difference(const DoseField& dose, double threshold, const RingIndex& target, int sub_pixels,
                    EdgeFigures& figures);

}  // namespace telefab::fab
