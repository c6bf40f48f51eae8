// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <optional>
#include <string>
#include <telefab/fab/mask/mask.hpp>
#include <telefab/machine/machine_profile.hpp>
#include <vector>

namespace telefab::fab {

/// One mask of the calibration and how long it is shown.
struct TestMask {
  std::string file;  ///< e.g. "wedge-085.png"
  Mask mask;
  double seconds = 0;
  std::string purpose;  ///< one line for people
};

struct TestMasks {
  std::vector<TestMask> masks;
  std::string measured_csv;  ///< header and one row for everything to measure, values left empty
  std::string readme;        ///< what to do and to measure
};

/// Grey wedge (16 even levels, whole frame each), field grid (cells of one white frame), line pairs (2 to 16 px,
/// standing and lying) and cure-depth stairs (8 patches, the k-th lit by the first k + 1 masks), for the pixels and the
/// exposure of a machine. Fails with InvalidInput for masks below 64 pixels a side.
[[nodiscard]] Result<TestMasks> calibration_masks(const MachineProfile& machine);
/// exposures.json of them.
[[nodiscard]] std::string exposures_json(const TestMasks& masks, const MachineProfile& machine);

/// One measurement. What a test does not use is left empty in the file.
struct MeasuredRow {
  enum class Test : std::uint8_t { Wedge = 1, Field = 2, Lines = 3, Depth = 4 };
  Test test = Test::Wedge;
  double grey = 255;      ///< wedge
  int row = 0;            ///< field: from the back, from 0
  int column = 0;         ///< field: from the left, from 0
  double period_px = 0;   ///< lines
  double exposure_s = 0;  ///< depth: all exposures of the patch together
  double value = 0;       ///< wedge, field: mW/cm2, or share; lines: contrast; depth: mm
  bool absolute = false;  ///< wedge, field: mW/cm2
};

/// Reads measured.csv: comma-separated, a header that names the columns in any order (test, grey, row, column,
/// period_px, exposure_s, value, unit), lines that start with # are left out. Units: wedge and field mW/cm2, W/m2 or
/// share; lines contrast; depth mm or um. Fails with InvalidInput: the line, the column, what is wrong.
[[nodiscard]] Result<std::vector<MeasuredRow>> measured_from_csv(std::string_view text);

/// A figure and the interval that holds it with 95 % confidence, as far as the scatter of the measurements tells.
struct FittedFigure {
  double value = 0;
  double least = 0;
  double most = 0;
};

struct Calibration {
  std::optional<FittedFigure> irradiance_mw_per_cm2;
  std::optional<FittedFigure> gamma;  ///< where a power fits the wedge to 1 % rms
  std::vector<double> curve;          ///< else the measured curve, made to never fall
  std::optional<FittedFigure> leak;
  double wedge_rms = 0;  ///< of the power's misfit, share of white
  std::vector<std::vector<double>> field;
  std::optional<FittedFigure> spread_px;
  std::optional<FittedFigure> critical_dose_mj_per_cm2;
  std::optional<FittedFigure> penetration_mm;
  double calibration_correlation = 0;  ///< of the errors of Dp and ln Ec
  double depth_rms_mm = 0;
};

/// Fits what the rows tell; what no row is about stays empty. Depths need the irradiance: from absolute readings of the
/// wedge or the field, else `irradiance_mw_per_cm2` (e.g. the profile's).
/// Fails with InvalidInput, and says which test and why: too few rows or settings, readings that no machine gives
/// (white is not the brightest, a contrast above what sharp lines have, depth that does not grow), figures outside the
/// profile's ranges, missing cells of the field, mixed units.
[[nodiscard]] Result<Calibration> fit_calibration(std::span<const MeasuredRow> rows, double irradiance_mw_per_cm2);

/// Sections [projection] and [resin] with what was fitted; intervals as comments, those of the resin also as keys.
[[nodiscard]] std::string to_toml_fragment(const Calibration& calibration);
/// The profile with what was fitted put in its place.
[[nodiscard]] MachineProfile calibrated(MachineProfile machine, const Calibration& calibration);

/// Contrast (most - least) / (most + least) of line pairs of a period, half of it lit (rounded down), on the vat.
[[nodiscard]] double line_contrast(double period_px, double spread_px, double leak);

}  // namespace telefab::fab
