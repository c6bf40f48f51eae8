// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <optional>
#include <string>
#include <telefab/fab/cure/calibration.hpp>
#include <telefab/geometry/layer.hpp>
#include <telefab/machine/machine_profile.hpp>
#include <vector>

namespace telefab::fab {

/// A body to be printed and measured: four bars side by side along x, each as wide as the others, shorter and higher
/// than the one before it; upright holes in the first. Its outline has four lengths along x and four along y, its top
/// four heights, so that what grows with a length (shrinkage) and what does not (edges) can be told apart.
struct SizeArtefact {
  LayerStack stack;          ///< in the middle of the platform, to be planned without supports
  std::string measured_csv;  ///< header and one row for everything to measure, values left empty
  std::string readme;        ///< what to do and to measure
};

/// As large as the platform holds, with bars 10 mm wide at most. Holes are stated as they will be drawn, with the
/// machine's hole_growth_mm. Fails with InvalidInput where a bar would be below 40 pixels wide or a step below 10
/// layers.
[[nodiscard]] Result<SizeArtefact> size_artefact(const MachineProfile& machine);

/// One measured length.
struct MeasuredSize {
  enum class Kind : std::uint8_t { LengthX = 1, LengthY = 2, Height = 3, Hole = 4 };
  Kind kind = Kind::LengthX;
  double drawn_mm = 0;     ///< holes: diameter
  double measured_mm = 0;  ///< likewise
};

/// Reads the filled-in file: columns test (length-x, length-y, height, hole), drawn_mm, value, unit (mm or um); else as
/// measured_from_csv().
[[nodiscard]] Result<std::vector<MeasuredSize>> sizes_from_csv(std::string_view text);

/// What a print of this machine and resin does to lengths. Lengths: drawn (1 - shrink) + 2 edge; heights: drawn (1 -
/// shrink) + height offset; diameters: drawn (1 - mean of x and y) - 2 hole growth.
struct SizeCalibration {
  std::optional<FittedFigure> shrink_x_percent, shrink_y_percent, shrink_z_percent;
  std::optional<FittedFigure> hole_growth_mm;
  std::optional<FittedFigure> edge_mm;           ///< how far each edge lies outside where it was drawn
  std::optional<FittedFigure> height_offset_mm;  ///< of whole heights: what the platform's first layers add or lack
  double rms_mm = 0;                             ///< misfit of all readings
};

/// Fits what the rows tell; what none is about stays empty. Fails with InvalidInput, and says which test and why: fewer
/// than three readings or two drawn lengths of a test, holes without lengths along x and y, readings that do not fit
/// together, figures outside the profile's ranges.
[[nodiscard]] Result<SizeCalibration> fit_sizes(std::span<const MeasuredSize> rows);

/// Section [resin] with what was fitted, intervals of 95 % as comments; what no key holds as comments.
[[nodiscard]] std::string to_toml_fragment(const SizeCalibration& calibration);
/// The profile with what was fitted put in its place.
[[nodiscard]] MachineProfile with_sizes(MachineProfile machine, const SizeCalibration& calibration);

}  // namespace telefab::fab
