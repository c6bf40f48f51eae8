// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <telefab/scan/contour/grid_tracer.hpp>
#include <telefab/scan/section/plane_cursor.hpp>
#include <vector>

namespace telefab::scan {

/// Adds points between the vertices of a ring until every chord keeps within the tolerance.
void refine(std::vector<PlaneSample>& ring, PlaneCursor& plane, double chord_mm);

/// Makes a contour of the ring and keeps it, unless it encloses nothing or is a spurious branch: the mean distance of
/// its vertices to the samples' own planes exceeds half a kernel width (paper 3.3).
void keep_ring(const std::vector<PlaneSample>& ring, const ScalarField& field, double z_mm,
               std::vector<Contour>& rings);

}  // namespace telefab::scan
