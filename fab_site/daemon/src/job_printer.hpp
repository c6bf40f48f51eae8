// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <atomic>
#include <mutex>
#include <optional>
#include <telefab/fab/print/machine_queue.hpp>
#include <telefab/fab/print/print_word.hpp>
#include <telefab/fab/print/start_rule.hpp>
#include <telefab/fab/web/page_backend.hpp>
#include <telefab/service/service_notifier.hpp>
#include <telefab/service/site.hpp>
#include <telefab/service/work_queue.hpp>

#include "open_questions.hpp"
#include "printing_machine.hpp"

namespace telefab::fab {

/// How a job left its machine.
struct PrintEnd {
  MachineTrouble trouble = MachineTrouble::None;  ///< of the machine
  bool is_nothing_made = false;  ///< no layer was exposed, nor perhaps: the platform is as empty as before
  std::string why;               ///< of trouble, for people
  bool goes_elsewhere = false;   ///< this machine was not found; another may print it, and nobody has to say so
  FenceRefusal withheld = FenceRefusal::None;  ///< it had no leave to light; it has any other reason to print still
};

/// What a printer tells whoever gives it jobs. Called on the loop's thread.
struct PrinterEvents {
  /// How the print stands, at every step of it; so many seconds of the clock on the wall are left, < 0: not known.
  std::function<void(const std::string& job, const PrintStanding& standing, double seconds_left)> progress;
  /// Whether another machine than the one it is on fits the job.
  std::function<bool(const std::string& job)> fits_elsewhere;
  /// The machine is free of the job, whose state says what becomes of it.
  std::function<void(const std::string& job, const PrintEnd& end)> ended;
  /// What look() found.
  std::function<void(const MachineLook& look)> looked;
};

/// One machine of the fab: prints one job at a time on a thread of its own, "device", which alone touches the
/// machine's devices. Threads: the loop's, but for what says otherwise.
class JobPrinter {
 public:
  /// Gives the profile that a job is printed with here.
  using ProfileOf = std::function<Result<MachineProfile>(const Job&)>;
  /// Gives the fence of a job; null: it needs no leave of anybody else. Fails where nobody can say so.
  using FenceOf = std::function<Result<std::shared_ptr<LightFence>>(const FoundJob&)>;
  struct Parts {
    std::string name;  ///< of the machine
    ProfileOf profile_of;
    FenceOf fence_of;
    std::unique_ptr<PrintingMachine> machine;
    StartPolicy at_start;
    PrinterEvents events;
  };
  /// Site and questions must outlive it.
  JobPrinter(Site& site, OpenQuestions& questions, Parts parts);
  ~JobPrinter();
  JobPrinter(const JobPrinter&) = delete;
  JobPrinter& operator=(const JobPrinter&) = delete;

  /// The job is printed now. It has no other: the one before has ended or was taken off.
  void begin(const std::string& job, MayStart may_start);
  /// Looks whether the machine is there, where that can be known without a print and no job is on it.
  void look();
  /// Takes a job off that is not yet under way; nothing more is tried for it.
  void take_off(const std::string& job);
  /// The control of the job's print; null where it is not under way here.
  [[nodiscard]] std::shared_ptr<PrintControl> control_of(const std::string& job);
  /// Keeps a word about a job that is not under way here. Fails as keep_word does, and with Conflict where it went on
  /// just now.
  [[nodiscard]] Result<void> keep(const Job& job, const PrintWord& word);
  /// How a job stands that is not under way here. Fails as start_case, and with Conflict where it went on just now.
  [[nodiscard]] Result<StartCase> case_of(const Job& job);
  /// The light off, of a machine whose print waits; what cannot be switched off is logged.
  void darken(const std::string& job);

  /// Whether the print under way, if there is one, still looks at its devices.
  [[nodiscard]] bool is_alive();
  /// Asks the print under way to go dark and to end with the site; nothing is begun any more.
  void ask_to_end();
  /// Whether one is under way; a look at the machine is none.
  [[nodiscard]] bool prints();
  [[nodiscard]] bool has_ended() const { return !queue_ || queue_->has_ended(); }

 private:
  [[nodiscard]] JobTracker& tracker() const { return site_.tracker(); }
  [[nodiscard]] JobStore& store() const { return site_.store(); }
  /// From any thread to the loop's.
  void later(std::function<void()> work) { site_.loop().post(std::move(work)); }

  /// Its thread, which begins with the first job.
  [[nodiscard]] WorkQueue& queue();
  /// Both on the device's thread.
  void look_now();
  void print(const std::string& job, std::stop_token stop);
  /// Whether the store says so now; if not, it is tried again. What the next start knows of this print begins there.
  [[nodiscard]] bool is_recorded_as_printing(const std::string& job);
  [[nodiscard]] Result<PrintReport> attempt(const std::string& job, PrintControl& control, const std::stop_token& stop);
  /// Whether the disk has room for what the print will write; false: the job waits for it.
  [[nodiscard]] bool has_room(const Job& job);

  /// Tries the job again after a while, unless it was taken off meanwhile.
  void add_after(Nanoseconds pause, const std::string& job);
  /// The job says why it waits, and is tried again.
  void wait_for_disk(const std::string& job, const Error& why);
  void on_progress(const std::string& job, const PrintStanding& standing);
  void on_ended(const std::string& job, const Result<PrintReport>& report);
  /// No report came: what becomes of the job. False: it stays on its machine, and is tried again.
  [[nodiscard]] bool leaves_without_report(const std::string& job, const Error& why, PrintEnd& end);
  void leaves_with(const std::string& job, const PrintReport& report);
  /// What the start rule would say of the job now. Fails as start_case.
  [[nodiscard]] Result<StartRuling> ruling_on(const std::string& job);
  [[nodiscard]] PrintEnd end_of(const std::string& job, const Result<PrintReport>& report);

  Site& site_;
  OpenQuestions& questions_;
  std::string name_;
  ProfileOf profile_of_;
  FenceOf fence_of_;
  std::unique_ptr<PrintingMachine> machine_;
  StartPolicy at_start_;
  PrinterEvents events_;
  std::string assigned_;  ///< the job it was given; empty: none

  bool is_ending_ = false;
  std::mutex mutex_;
  /// Guarded by mutex_, which is also held while a word goes into the journal of a job that does not print.
  std::string printing_;
  std::shared_ptr<PrintControl> control_;  ///< of the job being printed; guarded by mutex_
  double speed_up_ = 1;                    ///< of the print under way; guarded by mutex_
  MayStart may_start_ = MayStart::Yes;     ///< the job it was given; guarded by mutex_
  std::atomic<std::uint64_t> beats_ = 0;   ///< waits of the print under way; 0: none, or not so far yet
  Heartbeat beat_;
  std::optional<WorkQueue> queue_;  ///< begins with the first job: most machines of a catalogue never get one
};

}  // namespace telefab::fab
