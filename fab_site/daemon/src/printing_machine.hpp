// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <atomic>
#include <filesystem>
#include <memory>
#include <string>
#include <telefab/fab/print/print_runner.hpp>
#include <telefab/machine/machine_profile.hpp>

namespace telefab::fab {

/// What is to be printed, and how.
struct PrintTask {
  std::filesystem::path folder;  ///< of the job: plan/ in it, its journal and its report
  MachineProfile profile;        ///< the job's, on the devices of the machine
  std::string instance;          ///< name of the machine, for the record
  PrintPolicy policy;
};

/// What prints on one machine, whatever it is made of: the one place that knows whether that is a light engine and a
/// stage, or something that prints by itself. Threads: its printer's; go_dark() also from the loop's while nothing
/// prints.
class PrintingMachine {
 public:
  virtual ~PrintingMachine() = default;
  PrintingMachine(const PrintingMachine&) = delete;
  PrintingMachine& operator=(const PrintingMachine&) = delete;

  /// Prints what was planned into the folder, or goes on where its journal ends; both records are kept in its report.
  /// Opens the devices, and has let go of them when it returns, dark. `beats` rises several times a second while it
  /// goes on. Fails: device faults, StorageFailed, Conflict (held, another plan), NotTrusted.
  [[nodiscard]] virtual Result<PrintRecord> print(const PrintTask& task, PrintControl& control, const PrintSink& sink,
                                                  std::atomic<std::uint64_t>& beats, std::stop_token stop) = 0;
  /// Its light off, and nothing moved. Fails with device faults.
  [[nodiscard]] virtual Result<void> go_dark() = 0;

 protected:
  PrintingMachine() = default;
};

/// The machine that a profile describes. Nothing is opened before it is used.
[[nodiscard]] std::unique_ptr<PrintingMachine> printing_machine(const MachineProfile& profile);
/// Whether a print leaves a part on its platform; virtual machines make none.
[[nodiscard]] bool makes_parts(const MachineProfile& profile);

}  // namespace telefab::fab
