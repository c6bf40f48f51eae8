// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <filesystem>
#include <telefab/base/progress.hpp>
#include <telefab/fab/print/whole_print_runner.hpp>
#include <telefab/machine/machine_profile.hpp>

namespace telefab::fab {

/// A plan as a whole printer is given it, and the file that is sent.
struct WholePrintFile {
  WholePrintJob job;                ///< reads from the file as long as it is there
  std::uint32_t other_motions = 0;  ///< layers that tilt, which the file cannot say
};

/// Whether a file that lies there already is sent as it is.
enum class FileThere : std::uint8_t { IsMadeAgain, IsSent };

/// A name that every printer takes, another one for every plan.
[[nodiscard]] std::string name_on_printer(const PrintPlan& plan);

/// What keeps a plan from the printers of a profile, as far as that is known without one: InvalidInput.
[[nodiscard]] Result<void> check_whole_print(const PrintPlan& plan, const MachineProfile& machine);

/// Writes the file of a plan to `path`: the same plan gives the same bytes. Fails as check_whole_print and
/// export_masks.
[[nodiscard]] Result<WholePrintFile> whole_print_file(const PrintPlan& plan, MaskSource& masks,
                                                      const MachineProfile& machine, const std::filesystem::path& path,
                                                      FileThere there, const ProgressSink& progress,
                                                      std::stop_token stop);

}  // namespace telefab::fab
