// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <cstdint>
#include <optional>
#include <span>
#include <stop_token>
#include <telefab/base/result.hpp>
#include <telefab/geometry/certificate.hpp>
#include <telefab/scan/contour/reeb_marcher.hpp>
#include <telefab/scan/mls/scalar_field.hpp>
#include <vector>

namespace telefab::scan {

struct GridOptions {
  double chord_mm = 0.014;     ///< (0, 1]; a chord leaves the surface's section by this at most (paper: ds)
  double pitch_kernels = 0.5;  ///< (0, 1]; grid pitch of marching squares in kernel widths
  [[nodiscard]] Result<void> validate() const;
};

/// Where a contour stays open because no sample is near.
struct ContourGap {
  Point2 place;          ///< one end
  double size_mm = 0;    ///< to the nearest beginning of an open contour
  bool bridged = false;  ///< something else than this field closed it; false: the contour is left out
};

/// The rings found in one plane, canonical order, outer counter-clockwise, holes clockwise.
struct LayerTrace {
  std::vector<Contour> contours;
  std::vector<Doubt> faults;                 ///< gaps, crossings; empty for a sound layer
  std::vector<ContourGap> gaps;              ///< each also a fault
  std::uint64_t evaluations = 0;             ///< of the field
  [[nodiscard]] std::int32_t euler() const;  ///< outer minus hole rings
};

/// Marching squares with growth along sign changes from the samples near the plane, the paper's closeness pick (3.3)
/// and refinement to the chord tolerance; every vertex lies on g = 0 within the plane. Finds every contour that
/// passes a seed. Same input, same bytes. Fails: InvalidInput (options), TooLarge (limits.hpp), Cancelled.
[[nodiscard]] Result<LayerTrace> trace_by_grid(const ScalarField& field, FieldCursor& cursor, double z_mm,
                                               const SampleView& near, const GridOptions& options,
                                               std::stop_token stop);

/// Brings the rings into canonical order and adds the faults every method is judged by: crossings and nesting.
void finish_trace(LayerTrace& trace);

}  // namespace telefab::scan
