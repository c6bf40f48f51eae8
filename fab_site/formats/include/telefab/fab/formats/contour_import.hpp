// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <cstdint>
#include <optional>
#include <span>
#include <stop_token>
#include <string>
#include <string_view>
#include <telefab/base/progress.hpp>
#include <telefab/geometry/layer.hpp>
#include <telefab/machine/machine_profile.hpp>

namespace telefab::fab {

/// Files of contours that can be read; told apart by their first bytes.
enum class ImportFormat : std::uint8_t { Cli, Svg, ThreeMf, JsonLines };
[[nodiscard]] std::string_view name_of(ImportFormat format);
/// Nothing where the bytes begin like none of them.
[[nodiscard]] std::optional<ImportFormat> import_format_of(std::span<const std::byte> bytes);

struct ImportOptions {
  /// Millimetres of one unit of the file, (0, 1000], for files that state none; it must not contradict one that does.
  std::optional<double> unit_mm;
  /// Moves the part to the middle of the platform; else it stays where the file has it.
  bool centre = false;
  std::string name;  ///< of the file, for people
  [[nodiscard]] Result<void> validate() const;
};

/// What was done to the contours on the way in.
struct ImportReport {
  ImportFormat format = ImportFormat::Cli;
  std::uint64_t rings = 0;
  std::uint64_t vertices = 0;
  std::uint64_t turned_rings = 0;      ///< whose direction did not tell an outer ring from a hole as their nesting does
  std::uint64_t dropped_rings = 0;     ///< of fewer than three places
  std::uint64_t skipped_hatches = 0;   ///< fill lines of a CLI file
  std::uint32_t rebuilt_layers = 0;    ///< where rings touched or several parts met, and were united
  bool heights_in_millionths = false;  ///< the file gives heights in millionths of their millimetres, as Slic3r does
  double lowered_mm = 0;               ///< the lowest layer was put on the platform from this height
};

struct Import {
  LayerStack stack;
  ImportReport report;
};

/// Reads contours made elsewhere as a stack for a machine. Layers must be as thick as the machine's (within 2 %) and
/// without gaps; the lowest one is put on the platform. Rings may have any direction: what an odd number of rings of
/// one part surrounds is solid; parts are united. Certificates come out as Unchecked, Imported.
/// Fails: InvalidInput (not readable, no unit, curves, open lines, crossing rings with layer and place, wrong thickness
/// with both figures, outside of the platform, a part without a ring), TooLarge (limits.hpp; an archive that unpacks to
/// more than 1 GiB or 200 times its size), Cancelled. Safe on any bytes: sizes are checked before memory is taken.
[[nodiscard]] Result<Import> import_contours(std::span<const std::byte> bytes, const MachineProfile& machine,
                                             const ImportOptions& options, const ProgressSink& progress,
                                             std::stop_token stop);

}  // namespace telefab::fab
