// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <memory>
#include <optional>
#include <span>
#include <stop_token>
#include <string_view>
#include <telefab/base/progress.hpp>
#include <telefab/fab/formats/contour_import.hpp>
#include <telefab/fab/formats/sliced_file.hpp>
#include <telefab/fab/planning/ready_print.hpp>
#include <vector>

namespace telefab::fab {

/// A file as it came; kept as long as something reads from it.
using FileBytes = std::shared_ptr<const std::vector<std::byte>>;

/// A print that another program cut, to be planned for a machine.
struct ForeignPrint {
  std::string_view format;                  ///< for people: "CLI", "sl1", ...
  LayerStack stack;                         ///< its contours, or the outlines of its masks
  std::shared_ptr<const ReadyPrint> ready;  ///< of a file of masks
  std::optional<ImportReport> import;       ///< of a file of contours
  std::optional<SlicedJob> sliced;          ///< of a file of masks: what it says, layers included
};

/// True for bytes that read_foreign_print knows how to read.
[[nodiscard]] bool is_foreign_print(std::span<const std::byte> bytes);

/// Masks, times and motion of a sliced file for that machine; what the file leaves unsaid is the machine's own. `bytes`
/// are kept. Fails: as read_sliced_file does, and with InvalidInput where pixels, their pitch (1 %) or the thickness of
/// layers are not the machine's, where the printer is to stop on its way, and where a motion is impossible.
[[nodiscard]] Result<ReadyPrint> ready_for(const FileBytes& bytes, const MachineProfile& machine);

/// Reads contours (import_contours) or masks (ready_for, outlines_of) made elsewhere. `name` of the file, for people.
/// Fails as those do, and with InvalidInput where the bytes are none of the formats; the message lists them.
[[nodiscard]] Result<ForeignPrint> read_foreign_print(const FileBytes& bytes, const MachineProfile& machine,
                                                      std::string_view name, const ProgressSink& progress,
                                                      const std::stop_token& stop);

}  // namespace telefab::fab
