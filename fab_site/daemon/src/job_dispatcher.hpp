// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <atomic>
#include <map>
#include <memory>
#include <mutex>
#include <set>
#include <telefab/fab/daemon/serve_fab_site.hpp>
#include <telefab/fab/planning/preflight.hpp>
#include <telefab/fab/print/lease_book.hpp>
#include <telefab/job/machine_status.hpp>
#include <telefab/service/site.hpp>

#include "fab_machines.hpp"
#include "job_printer.hpp"
#include "open_questions.hpp"
#include "platforms.hpp"
#include "print_orders.hpp"

namespace telefab::fab {

/// Gives planned jobs to the machines of the fab, each with a printer and a thread of its own, and carries out what is
/// commanded about them. Which job goes where is MachineQueue's to say; here that is made durable before anything
/// moves. Threads: the loop's, but for what says otherwise.
class JobDispatcher {
 public:
  /// Site and leases, those of this fab, must outlive it.
  JobDispatcher(Site& site, const FabSiteConfig& config, FabMachines machines, LeaseBook& leases);
  JobDispatcher(const JobDispatcher&) = delete;
  JobDispatcher& operator=(const JobDispatcher&) = delete;

  /// The job is planned: it is printed, or waits for somebody's approval.
  void planned(const std::string& job, const Preflight& preflight);
  /// Goes on with a job that was planned when the site ended last, as far as the start rule lets it. Fails where the
  /// job's folder cannot be read, and with Conflict where it began on a machine that is not here any more.
  [[nodiscard]] Result<void> resume(const Job& job);

  /// Approve, pause, resume or cancel a job that is not at its end. The answer comes once the job's journal has the
  /// word.
  void command(const Job& job, const Command& command, std::function<void(Result<Job>)> done);
  /// An operator says that the platform of the machine is empty, or that it is ready again. The job whose part was on
  /// it, or that met the trouble; one without an id where there is none.
  [[nodiscard]] Result<Job> clear_platform(const std::string& machine);

  /// Something changed of the lease of a job of a fleet, by its id here: what waited for it goes on, what is over ends.
  void lease_changed(const std::string& job);
  /// What stands in the fab.
  [[nodiscard]] const FabMachines& machines() const { return machines_; }
  [[nodiscard]] const std::vector<QueuedMachine>& stand() const { return queue_.machines(); }

  /// What somebody is to decide about the job, and nobody has yet. Any thread.
  [[nodiscard]] OpenQuestion question_about(const std::string& job) const { return questions_.about(job); }
  /// The machine whose platform the job waits for, as another part is on it; empty: none. Any thread.
  [[nodiscard]] std::string platform_waited_for(const std::string& job);
  /// What every machine is at, in the order of the list. Any thread.
  [[nodiscard]] std::vector<MachineStatus> standing();
  /// What the print on a machine does this moment; nothing where none is under way. Any thread.
  [[nodiscard]] std::optional<MachineMoment> moment(std::string_view machine);
  /// Grows with every change of standing() and moment() that is not one of a job's own. Any thread.
  [[nodiscard]] std::uint64_t revision() const { return revision_; }

  /// Whether a print under way, if there is any, still looks at its devices. One that does not is told by standing(),
  /// and stops none that does.
  [[nodiscard]] bool is_alive();
  /// Asks the prints under way to go dark and to end with the site; nothing is begun any more.
  void ask_to_end();
  [[nodiscard]] bool is_idle() const;
  [[nodiscard]] bool has_ended() const;

 private:
  [[nodiscard]] JobTracker& tracker() const { return site_.tracker(); }
  [[nodiscard]] JobStore& store() const { return site_.store(); }
  [[nodiscard]] std::unique_ptr<JobPrinter> make_printer(std::size_t place, const FabSiteConfig& config);
  /// Whole printers that have no job are looked for, now and again.
  void look_at_printers();
  void on_look(std::size_t place, const MachineLook& look);
  /// Whose light the job was given to, or would be as far as that is known.
  [[nodiscard]] LightOf light_of(const Job& job) const;
  /// The printer that has the job; null: none.
  [[nodiscard]] JobPrinter* printer_of(const std::string& job);

  /// The job may print: it gets a machine, now or later.
  void wait_for_machine(const std::string& job, InTrouble in_trouble = InTrouble::Waits);
  /// A job that was let print and is not on a machine.
  [[nodiscard]] static bool may_wait(const Job& job);
  /// Whether the fleet, where the job is one of it, lets it print here; else it waits for that, or is over.
  [[nodiscard]] bool has_leave(const Job& job);
  /// A print that had no leave to light goes on once it has; it is dark, and nothing moves.
  void wait_for_leave(const std::string& job);
  /// The places that fit the job; of a fleet's job the one that it is leased for alone.
  [[nodiscard]] FabMachines::Fits fits(const Job& job) const;
  [[nodiscard]] bool fits_elsewhere(const std::string& job);
  /// What waits gets the machines that are free.
  void dispatch();
  /// From the loop: at a start every print that has begun is known before anything is given away.
  void dispatch_soon();
  /// Durable: where the job is, and whose part is on that platform. Then it begins. Where that cannot be written the
  /// job waits, and is tried again.
  void put_on(const Assignment& assignment);
  [[nodiscard]] Result<void> record_place(const Assignment& assignment);
  /// Says at each job that waits why it does.
  void explain_waits();
  [[nodiscard]] std::string sentence_of(const Wait& wait) const;
  void publish();

  void on_progress(const std::string& job, const PrintStanding& standing, double seconds_left);
  void on_left(const std::string& job, const PrintEnd& end);
  void on_job_end(const std::string& job);

  /// Platforms as they were kept; the one of a profile goes to its only machine.
  void read_platforms();
  /// No part is on that platform any more, under any name that it had.
  [[nodiscard]] Result<void> empty_platform(std::size_t place);
  /// Where a job began whose part is made, by the list, by the platforms, by its machine's name. Nothing: nobody
  /// knows. Fails with Conflict where that machine does not stand here any more.
  [[nodiscard]] Result<std::optional<std::size_t>> where_begun(const Job& job) const;
  /// What the start rule says of a job, carried out.
  void follow(const Job& job, const StartCase& before, const StartVerdict& verdict);
  /// The job goes on at its printer whatever is done here; it is watched.
  void watch(const std::string& job);

  /// Keeps a word about a job that is not on its machine. Fails as keep_word does.
  [[nodiscard]] Result<void> keep(const Job& job, const PrintWord& word);
  /// Approves or resumes a job that is not on its machine, and lets it wait for one.
  [[nodiscard]] Result<void> let_print(const Job& job, const PrintWord& word);
  [[nodiscard]] Result<void> approve(const Job& job, const Command& command);
  /// Whether a whole printer was asked for it and it is not over, so that a word about it is the printer's to follow.
  [[nodiscard]] Result<bool> is_at_printer(const Job& job);
  /// The printer gets the word as soon as it is watched again.
  void pass_to_printer(const Job& job, std::string_view message);
  /// Both of a job that is not on its machine, or not yet.
  [[nodiscard]] Result<void> pause(const Job& job, const std::string& who);
  [[nodiscard]] Result<void> cancel(const Job& job, const std::string& who);
  /// Hands the command to the print under way; `done` is called once its journal has it.
  void pass_to_print(const Command& command, const std::shared_ptr<PrintControl>& control,
                     std::function<void(Result<Job>)> done);

  /// What is shown of a machine beside its standing.
  struct Shown {
    double seconds_left = -1;
    std::string why;           ///< it is in trouble
    std::string left_by = {};  ///< the job that met it
    std::optional<MachineMoment> now = {};
    bool has_hung = false;  ///< the print on it no longer looks at its devices
  };

  Site& site_;
  StartPolicy at_start_;
  bool start_on_approval_;
  FabMachines machines_;
  LeaseBook& leases_;
  Platforms platforms_;
  OpenQuestions questions_;
  MachineQueue queue_;
  std::set<std::string> for_lease_;               ///< jobs that were let print, and wait for their lease alone
  std::set<std::string> for_leave_;               ///< jobs that wait for leave to light
  std::set<std::string> only_watched_;            ///< jobs that go on at their printer, of which nothing may be started
  std::map<std::string, std::string> explained_;  ///< why each job that waits does, as it was last said
  std::vector<Shown> shown_;                      ///< by machine
  std::mutex mutex_;
  std::map<std::string, std::string> for_platform_;  ///< machine by job that waits for its platform; guarded by mutex_
  std::vector<MachineStatus> published_;             ///< guarded by mutex_
  std::map<std::string, MachineMoment, std::less<>> moments_;  ///< by machine; guarded by mutex_
  std::atomic<std::uint64_t> revision_ = 0;
  bool is_ending_ = false;
  bool is_dispatch_due_ = false;
  std::vector<std::unique_ptr<JobPrinter>> printers_;  ///< by machine; last: their threads know the rest
};

}  // namespace telefab::fab
