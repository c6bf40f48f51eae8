// SPDX-License-Identifier: GPL-3.0-or-later
#include "printing_machine.hpp"

#include <telefab/fab/drivers/make_devices.hpp>

#include "plan_print.hpp"

namespace telefab::fab {
namespace {

/// A light engine above a stage: the fab times the light layer by layer.
class LightAndStage final : public PrintingMachine {
 public:
  explicit LightAndStage(MachineProfile profile) : profile_{std::move(profile)} {}

  Result<PrintRecord> print(const PrintTask& task, PrintControl& control, const PrintSink& sink,
                            std::atomic<std::uint64_t>& beats, std::stop_token stop) override {
    return print_from(task, control, sink, beats, std::move(stop));
  }
  Result<void> go_dark() override { return fab::go_dark(profile_); }

 private:
  MachineProfile profile_;
};

}  // namespace

std::unique_ptr<PrintingMachine> printing_machine(const MachineProfile& profile) {
  return std::make_unique<LightAndStage>(profile);
}

bool makes_parts(const MachineProfile& profile) { return !is_simulated(profile); }

}  // namespace telefab::fab
