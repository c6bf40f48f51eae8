// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <atomic>
#include <filesystem>
#include <telefab/base/progress.hpp>
#include <telefab/fab/planning/preflight.hpp>
#include <telefab/fab/print/print_runner.hpp>

#include "intake.hpp"
#include "printing_machine.hpp"

namespace telefab::fab {

/// What the daemon wants to know of a plan.
struct PlanOutcome {
  std::uint32_t print_layers = 0;
  Preflight preflight;  ///< what may hold it
};

/// Plans what was received into folder/plan: its contours as they came, supports, masks, exposures, pictures and
/// reports. How well the scan's views lie on each other is taken from the saved offer. Fails as write_plan_folder.
[[nodiscard]] Result<PlanOutcome> plan_into(const std::filesystem::path& folder, const ReceivedStack& part,
                                            const MachineProfile& machine, PlanOptions options, const Clock& clock,
                                            const ProgressSink& progress, std::stop_token stop);

/// Prints what plan_into planned by light engine and stage, or goes on where the journal ends. The record goes to
/// report/print.json. `beats` rises with every wait of the runner, several times a second; when it stands still, the
/// print hangs.
[[nodiscard]] Result<PrintRecord> print_from(const PrintTask& task, PrintControl& control, const PrintSink& sink,
                                             std::atomic<std::uint64_t>& beats, std::stop_token stop);

/// Bytes that a print from the folder still takes on its disk: the journal, where none is begun, the records, and the
/// file for a whole printer, about as far as its masks tell.
[[nodiscard]] std::uint64_t print_room_bytes(const std::filesystem::path& folder, LayerIndex layers, LightOf light);

/// A held job is printed on the word of somebody who knew what holds it, and on no other: Conflict. Fails where the
/// plan's preflight cannot be read.
[[nodiscard]] Result<void> check_let_through(const std::filesystem::path& folder, const PrintJournal& orders);

/// As darken() of its devices: its stage is touched only where its board switches the light.
[[nodiscard]] Result<void> go_dark(const MachineProfile& machine);

}  // namespace telefab::fab
