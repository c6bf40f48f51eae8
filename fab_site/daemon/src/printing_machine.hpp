// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <atomic>
#include <filesystem>
#include <memory>
#include <optional>
#include <string>
#include <telefab/fab/print/light_fence.hpp>
#include <telefab/fab/print/machine_queue.hpp>
#include <telefab/fab/print/print_runner.hpp>
#include <telefab/fab/web/page_backend.hpp>
#include <telefab/machine/machine_profile.hpp>

#include "open_questions.hpp"
#include "print_orders.hpp"

namespace telefab::fab {

/// Whether a print may start what has not been started, or only goes on with what was.
enum class MayStart : std::uint8_t { Yes, No };

/// What is to be printed, and how.
struct PrintTask {
  std::filesystem::path folder;    ///< of the job: plan/ in it, its journal and its report
  Result<MachineProfile> profile;  ///< the job's, on the devices of the machine; or why there is none any more
  std::string instance;            ///< name of the machine, for the record
  PrintPolicy policy;
  MayStart may_start = MayStart::Yes;
  LayerIndex seen;                         ///< layers that the job store has seen printed
  std::shared_ptr<LightFence> fence = {};  ///< without whose leave nothing lights; null: a job of this fab alone
};

/// What a print is at, for the daemon.
enum class PrintActivity : std::uint8_t {
  Works,
  Paused,
  AwaitsDecision,  ///< OpenQuestion::Exposure
  Faulted,
  Over,  ///< its report follows
};
struct PrintStanding {
  PrintActivity activity = PrintActivity::Works;
  LayerIndex layer;  ///< layers made
  LayerIndex layers;
  std::optional<Nanoseconds> left;        ///< none: not known
  std::string message;                    ///< for people; empty: nothing to say
  bool is_lost = false;                   ///< it goes on out of reach
  std::optional<MachineMoment> now = {};  ///< none: the machine does not say
};
using StandingSink = std::function<void(const PrintStanding&)>;

/// How a print left its machine.
enum class PrintVerdict : std::uint8_t {
  Done,
  Cancelled,
  Waits,   ///< goes on when somebody says so
  Failed,  ///< over, and not made
};
struct PrintReport {
  PrintVerdict verdict = PrintVerdict::Waits;
  LayerIndex next;                                ///< layers made
  OpenQuestion question = OpenQuestion::None;     ///< Waits
  bool is_nothing_made = false;                   ///< no layer was exposed, nor perhaps
  MachineTrouble trouble = MachineTrouble::None;  ///< of the machine
  FenceRefusal withheld = FenceRefusal::None;     ///< Waits: the fence gave no leave to light
  std::string why;                                ///< of trouble, for people
  std::string message;                            ///< for people: what became of it and what to do; may be empty
};

/// What a look at a machine on which no job is has found.
struct MachineLook {
  bool is_found = true;
  std::string foreign;  ///< what it prints that is no job of the fab, for people; empty: nothing
  std::string why;      ///< it was not found
};

/// What is wrong with a machine that failed so.
[[nodiscard]] MachineTrouble trouble_of(const Error& why);

/// What prints on one machine, whatever it is made of: the one place that knows whether that is a light engine and a
/// stage, or something that prints by itself. Threads: its printer's; go_dark() also from the loop's while nothing
/// prints.
class PrintingMachine {
 public:
  virtual ~PrintingMachine() = default;
  PrintingMachine(const PrintingMachine&) = delete;
  PrintingMachine& operator=(const PrintingMachine&) = delete;

  [[nodiscard]] virtual LightOf light() const = 0;
  /// Prints what was planned into the folder, or goes on where its journal ends; both records are kept in its report.
  /// Opens the devices, and has let go of them when it returns; those whose light is the fab's are dark then. `beats`
  /// rises while it goes on, and never rests for longest_silence(). Fails: device faults, StorageFailed, Conflict
  /// (held, another plan or profile, none, a part that began by another light), NotTrusted.
  [[nodiscard]] virtual Result<PrintReport> print(const PrintTask& task, PrintControl& control,
                                                  const StandingSink& sink, std::atomic<std::uint64_t>& beats,
                                                  std::stop_token stop) = 0;
  [[nodiscard]] virtual Nanoseconds longest_silence() const = 0;
  /// Its light off, and nothing moved; nothing where the light is its own. Fails with device faults.
  [[nodiscard]] virtual Result<void> go_dark() = 0;
  /// Looks whether it is there, while no job is on it. Nothing: there is nothing to look at before a print.
  [[nodiscard]] virtual std::optional<MachineLook> look() = 0;

 protected:
  PrintingMachine() = default;
};

/// The machine that a profile describes. Nothing is opened before it is used.
[[nodiscard]] std::unique_ptr<PrintingMachine> printing_machine(const MachineProfile& profile);
/// Whose light it is.
[[nodiscard]] LightOf light_of(const MachineProfile& profile);
/// Whether a print leaves a part on its platform; virtual machines make none.
[[nodiscard]] bool makes_parts(const MachineProfile& profile);

}  // namespace telefab::fab
