// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <filesystem>
#include <telefab/base/progress.hpp>
#include <telefab/fab/print/print_plan.hpp>
#include <telefab/fab/print/print_runner.hpp>

namespace telefab::fab {

/// Files of masks that printers and their tools take.
enum class MaskFormat : std::uint8_t {
  Sl1,      ///< Prusa SL1, SL1S, M1; UVtools converts it for most resin printers
  NanoDlp,  ///< NanoDLP and the machines built on it
  Goo,      ///< Elegoo; states every layer's exposure, motion and light
};

/// A layer whose exposure a printer makes otherwise than planned.
struct FadedLayer {
  LayerIndex layer;
  double planned_s = 0;
  double made_s = 0;
};
/// What one of the programs that read SL1 archives makes of the exposures.
struct FadedLayers {
  FadeReader reader = FadeReader::Slafw;
  std::vector<FadedLayer> layers;  ///< that differ by more than a thousandth, in order
  double most_error = 0;           ///< share of the planned exposure
};

/// What a file could not say of the plan.
struct MaskExportReport {
  std::uint32_t layers = 0;
  /// Lit layers whose exposure the printer makes otherwise by more than a thousandth: SL1 and NanoDLP hold two
  /// exposures a job and what lies between. For SL1 as the program that the profile names (file.fade) reads it.
  std::uint32_t other_exposures = 0;
  double most_exposure_error = 0;  ///< of these, share of the planned one; above file.most_exposure_error: to be held
  std::uint32_t fade = 0;          ///< sl1: numFade
  std::vector<FadedLayers> fades;  ///< sl1: one a reader
  /// Lit layers that move or wait neither as the bottom nor as most others do, beyond what tilts by area say; for GOO,
  /// which has no word for a tilt, those that tilt.
  std::uint32_t other_motions = 0;
  double solid_mm3 = 0;  ///< grey-weighted volume
};

/// What export_masks would report, but for the volume, without a mask. Fails as it does before the first one.
[[nodiscard]] Result<MaskExportReport> survey_export(MaskFormat format, const PrintPlan& plan,
                                                     const MachineProfile& machine, const std::filesystem::path& path);

/// Writes the masks of a plan as one file: 8-bit grey PNGs in an archive, or GOO's packed pixels. The pictures are
/// turned as projection.orientation of the machine says, and the file states it, for firmware turns nothing by itself.
/// Masks come one at a time; memory is that of one mask. Same plan, same bytes; the file appears whole or not at all.
/// Fails: InvalidInput (the plan is not of this machine, more than 99,999 layers, no layer; light that is dimmed, which
/// SL1 and NanoDLP leave to the printer, or to a share that is none of GOO's 255 steps; exposures that SL1 printers
/// refuse; a file name of another SL1 model), Cancelled, as the masks do, StorageFailed.
[[nodiscard]] Result<MaskExportReport> export_masks(MaskFormat format, const PrintPlan& plan, MaskSource& masks,
                                                    const MachineProfile& machine, const std::filesystem::path& path,
                                                    const ProgressSink& progress, std::stop_token stop);

}  // namespace telefab::fab
