// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <filesystem>
#include <span>
#include <telefab/fab/planning/plan_job.hpp>
#include <telefab/fab/print/print_runner.hpp>

namespace telefab::fab {

/// plan_job into a folder: masks/00000.png.., plan.json, supports.json, supports.jsonl (the support's rings, one
/// line a print layer), part.tfc, preview.png, report.json, preflight.json. The folder appears whole or not at all; one
/// that holds an older plan is replaced, any other that is not empty is refused. `tfc` is the file the stack was read
/// from, kept as part.tfc; where it is empty the stack is encoded (Coding::Exact). Fails as plan_job does, and with
/// Conflict (folder holds something else), NotPermitted, StorageFailed.
[[nodiscard]] Result<PlanSummary> write_plan_folder(const std::filesystem::path& folder, const LayerStack& stack,
                                                    const MachineProfile& machine, const PlanOptions& options,
                                                    const Clock& clock, const ProgressSink& progress,
                                                    std::stop_token stop, std::span<const std::byte> tfc = {});

/// A plan on disk. Masks are read when asked for and checked against the plan's digest.
class PlannedJob final : public MaskSource {
 public:
  /// Fails: NotFound, InvalidInput (plan.json is damaged, a mask is missing).
  [[nodiscard]] static Result<std::unique_ptr<PlannedJob>> open(const std::filesystem::path& folder);
  [[nodiscard]] const PrintPlan& plan() const { return plan_; }
  /// Fails: NotFound, InvalidInput (size), NotTrusted (digest; names the file).
  [[nodiscard]] Result<Mask> mask(LayerIndex layer) override;
  /// Of the mask's PNG.
  [[nodiscard]] std::filesystem::path mask_path(LayerIndex layer) const;
  /// The part that was planned. Fails: NotFound (planned before part.tfc was kept), as read_tfc does.
  [[nodiscard]] Result<LayerStack> part() const;
  /// The rings of the supports, one element a print layer. Fails: NotFound, InvalidInput (names the line).
  [[nodiscard]] Result<std::vector<std::vector<Contour>>> supports() const;

 private:
  PlannedJob(std::filesystem::path folder, PrintPlan plan) : folder_{std::move(folder)}, plan_{std::move(plan)} {}
  std::filesystem::path folder_;
  PrintPlan plan_;
};

}  // namespace telefab::fab
