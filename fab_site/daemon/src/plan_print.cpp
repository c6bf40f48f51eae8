#include "plan_print.hpp"

#include <fmt/format.h>

#include <telefab/base/file.hpp>
#include <telefab/fab/drivers/make_devices.hpp>
#include <telefab/fab/planning/plan_folder.hpp>

namespace telefab::fab {

Result<PlanOutcome> plan_into(const std::filesystem::path& folder, const std::string& job, const LayerStack& stack,
                              const MachineProfile& machine, const Clock& clock, const ProgressSink& progress,
                              std::stop_token stop) {
  PlanOptions options;
  options.job = job;
  const auto summary = write_plan_folder(folder / "plan", stack, machine, options, clock, progress, std::move(stop));
  if (!summary) return tl::unexpected{summary.error()};
  PlanOutcome outcome{static_cast<std::uint32_t>(summary->plan.layers.size()), {}};
  if (!summary->check.passes()) {
    const Finding& first = summary->check.findings.front();
    outcome.doubt = fmt::format(
        "the check of the masks has {} findings, the first: {} in layer {} at ({:.1f}, {:.1f}) mm",
        summary->check.findings.size(), name_of(first.kind), first.layer.count(), first.place.x_mm, first.place.y_mm);
  }
  return outcome;
}

Result<PrintRecord> print_from(const std::filesystem::path& folder, const MachineProfile& machine,
                               const PrintPolicy& policy, PrintControl& control, const PrintSink& sink,
                               std::stop_token stop) {
  const auto job = PlannedJob::open(folder / "plan");
  if (!job) return tl::unexpected{job.error()};
  const auto clock = make_clock(machine);
  auto devices = make_devices(machine, *clock);
  if (!devices) return tl::unexpected{devices.error()};
  auto file = open_journal_file(folder / "journal");
  if (!file) return tl::unexpected{file.error()};
  auto journal = PrintJournal::open(std::move(*file));
  if (!journal) return tl::unexpected{journal.error()};
  PrintPolicy scaled = policy;
  // A machine that runs faster than real time is looked at less often in its own time.
  if (devices->log)
    scaled.slice =
        Nanoseconds{static_cast<std::int64_t>(static_cast<double>(policy.slice.count()) * machine.devices.speed_up)};
  PrintRunner runner{*devices->projector, *devices->stage, **job, *journal, *clock};
  auto record = runner.run((*job)->plan(), scaled, control, sink, std::move(stop));
  if (!record) return record;
  std::error_code error;
  std::filesystem::create_directories(folder / "report", error);
  if (auto kept = write_file_atomically(folder / "report" / "print.json", to_json(*record) + "\n"); !kept)
    return tl::unexpected{kept.error()};
  return record;
}

}  // namespace telefab::fab
