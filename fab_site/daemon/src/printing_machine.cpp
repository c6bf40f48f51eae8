// SPDX-License-Identifier: GPL-3.0-or-later
#include "printing_machine.hpp"

#include <fmt/format.h>

#include <telefab/fab/drivers/make_devices.hpp>

#include "plan_print.hpp"
#include "whole_printer_machine.hpp"

namespace telefab::fab {
namespace {

PrintActivity activity_of(PrintPhase phase) {
  switch (phase) {
    case PrintPhase::Paused:
      return PrintActivity::Paused;
    case PrintPhase::AwaitingDecision:
      return PrintActivity::AwaitsDecision;
    case PrintPhase::Faulted:
      return PrintActivity::Faulted;
    case PrintPhase::Done:
    case PrintPhase::Cancelled:
      return PrintActivity::Over;
    default:
      return PrintActivity::Works;
  }
}

PrintReport report_of(const PrintRecord& record) {
  PrintReport report;
  report.next = record.next;
  report.is_nothing_made = record.layers.empty() && !record.maybe_exposed;
  switch (record.outcome) {
    case PrintOutcome::Done:
      report.verdict = PrintVerdict::Done;
      break;
    case PrintOutcome::Cancelled:
      report.verdict = PrintVerdict::Cancelled;
      report.message = fmt::format("at layer {}", record.next.count());
      break;
    case PrintOutcome::Faulted:
      report.verdict = PrintVerdict::Waits;
      if (record.withheld != FenceRefusal::None) {  // nothing is wrong with the machine
        report.withheld = record.withheld;
        report.why = report.message = record.cause.what;
        break;
      }
      if (record.maybe_exposed) report.question = OpenQuestion::Exposure;
      report.trouble = trouble_of(record.cause);
      // Whatever it broke off by, somebody is to look at the machine.
      if (report.trouble == MachineTrouble::None) report.trouble = MachineTrouble::Fault;
      report.why = record.cause.what;
      report.message = fmt::format(
          "faulted at layer {}: {}; {}", record.next.count(), record.cause.what,
          record.maybe_exposed ? "the layer was perhaps exposed: telefab resume --as treat-as-exposed|expose-again"
                               : "telefab resume tries again");
  }
  return report;
}

/// A light engine above a stage: the fab times the light layer by layer.
class LightAndStage final : public PrintingMachine {
 public:
  explicit LightAndStage(MachineProfile profile) : profile_{std::move(profile)} {}

  LightOf light() const override { return LightOf::Fab; }
  Result<PrintReport> print(const PrintTask& task, PrintControl& control, const StandingSink& sink,
                            std::atomic<std::uint64_t>& beats, std::stop_token stop) override {
    if (auto may = forget_unasked(task.folder, task.instance); !may) return tl::unexpected{may.error()};
    const auto record = print_from(
        task, control,
        [&](const PrintProgress& progress) {
          sink({activity_of(progress.phase), progress.layer, progress.layers, progress.left, progress.message, false,
                MachineMoment{std::string{name_of(progress.phase)}, progress.phase == PrintPhase::Exposing,
                              progress.z_mm, progress.resin_celsius}});
        },
        beats, std::move(stop));
    if (!record) return tl::unexpected{record.error()};
    return report_of(*record);
  }
  Nanoseconds longest_silence() const override { return std::chrono::seconds{30}; }
  Result<void> go_dark() override { return fab::go_dark(profile_); }
  std::optional<MachineLook> look() override { return std::nullopt; }

 private:
  MachineProfile profile_;
};

}  // namespace

MachineTrouble trouble_of(const Error& why) {
  if (why.code == ErrorCode::DeviceLost) return MachineTrouble::Lost;
  return is_device_fault(why.code) ? MachineTrouble::Fault : MachineTrouble::None;
}

std::unique_ptr<PrintingMachine> printing_machine(const MachineProfile& profile) {
  if (light_of(profile) == LightOf::WholePrinter) return std::make_unique<WholePrinterMachine>(profile);
  return std::make_unique<LightAndStage>(profile);
}

LightOf light_of(const MachineProfile& profile) {
  return profile.devices.printer == PrinterKind::None ? LightOf::Fab : LightOf::WholePrinter;
}

bool makes_parts(const MachineProfile& profile) { return !is_simulated(profile); }

}  // namespace telefab::fab
