// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <filesystem>
#include <telefab/base/progress.hpp>
#include <telefab/fab/print/print_plan.hpp>
#include <telefab/fab/print/print_runner.hpp>

namespace telefab::fab {

/// Archives of masks that printers and their tools take.
enum class MaskFormat : std::uint8_t {
  Sl1,      ///< Prusa SL1; UVtools converts it for most resin printers
  NanoDlp,  ///< NanoDLP and the machines built on it
};

/// What an archive could not say of the plan.
struct MaskExportReport {
  std::uint32_t layers = 0;
  /// Lit layers whose exposure is neither the bottom one nor the normal one: both formats hold two exposures a job.
  std::uint32_t other_exposures = 0;
  /// Lit layers that move or wait neither as the bottom nor as most others do, beyond what tilts by area say.
  std::uint32_t other_motions = 0;
  double solid_mm3 = 0;  ///< grey-weighted volume
};

/// Writes the masks of a plan as one archive of 8-bit grey PNGs. The pictures are turned as projection.orientation of
/// the machine says, and the archive states it, for firmware turns nothing by itself. Masks come one at a time; memory
/// is that of one mask. Same plan, same bytes; the file appears whole or not at all.
/// Fails: InvalidInput (the plan is not of this machine, more than 99,999 layers, no layer, light that is dimmed: both
/// formats leave that to the printer), Cancelled, as the masks
/// do, StorageFailed.
[[nodiscard]] Result<MaskExportReport> export_masks(MaskFormat format, const PrintPlan& plan, MaskSource& masks,
                                                    const MachineProfile& machine, const std::filesystem::path& path,
                                                    const ProgressSink& progress, std::stop_token stop);

}  // namespace telefab::fab
