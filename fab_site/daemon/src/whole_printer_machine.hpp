// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include "printing_machine.hpp"

namespace telefab::fab {

/// A printer that owns its light and takes a file (decision 0815). The print is sent, started once and watched; ending
/// the daemon, or losing it, ends no print there.
class WholePrinterMachine final : public PrintingMachine {
 public:
  explicit WholePrinterMachine(MachineProfile profile) : profile_{std::move(profile)} {}

  LightOf light() const override { return LightOf::WholePrinter; }
  Result<PrintReport> print(const PrintTask& task, PrintControl& control, const StandingSink& sink,
                            std::atomic<std::uint64_t>& beats, std::stop_token stop) override;
  Nanoseconds longest_silence() const override;
  Result<void> go_dark() override { return {}; }
  std::optional<MachineLook> look() override;

 private:
  MachineProfile profile_;
};

/// A printer's journal that lies in the folder of a print without having asked anything of a printer is taken away: the
/// print may be made by other light. Conflict: a printer was asked; NotTrusted: it is damaged.
[[nodiscard]] Result<void> forget_unasked(const std::filesystem::path& folder, const std::string& machine);

}  // namespace telefab::fab
