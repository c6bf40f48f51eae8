// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <atomic>
#include <mutex>
#include <set>
#include <telefab/fab/daemon/serve_fab_site.hpp>
#include <telefab/service/service_notifier.hpp>
#include <telefab/service/site.hpp>
#include <telefab/service/work_queue.hpp>

#include "plan_print.hpp"
#include "platforms.hpp"
#include "print_orders.hpp"

namespace telefab::fab {

/// Prints planned jobs one after the other on the thread "device", which alone touches the devices, and carries out
/// what is commanded about planned jobs. Threads: the loop's, but for what says otherwise.
class JobPrinter {
 public:
  /// The site must outlive it.
  JobPrinter(Site& site, const FabSiteConfig& config);
  ~JobPrinter();
  JobPrinter(const JobPrinter&) = delete;
  JobPrinter& operator=(const JobPrinter&) = delete;

  /// The job is planned: it is printed, or waits for somebody's approval.
  void planned(const std::string& job, const Preflight& preflight);
  /// Goes on with a job that was planned when the site ended last, as far as the start rule lets it. Fails where the
  /// job's folder cannot be read.
  [[nodiscard]] Result<void> resume(const Job& job);

  /// Approve, pause, resume or cancel a job that is not at its end. The answer comes once the job's journal has the
  /// word.
  void command(const Job& job, const Command& command, std::function<void(Result<Job>)> done);
  /// An operator says that the platform of the machine is empty. The job whose part was on it.
  [[nodiscard]] Result<Job> clear_platform(const std::string& machine);

  /// A layer of the job was perhaps exposed, and nobody has decided yet. Any thread.
  [[nodiscard]] bool is_exposure_unknown(const std::string& job);
  /// Another part is on the platform that the job needs. Any thread.
  [[nodiscard]] bool waits_for_platform(const std::string& job);
  /// Whether the print under way, if there is one, still looks at its devices.
  [[nodiscard]] bool is_alive();

  /// Asks the print under way to go dark and to end with the site; nothing is begun any more.
  void ask_to_end() { queue_.ask_to_end(); }
  [[nodiscard]] bool is_idle() const { return queue_.is_idle(); }
  [[nodiscard]] bool has_ended() const { return queue_.has_ended(); }

 private:
  [[nodiscard]] JobTracker& tracker() const { return site_.tracker(); }
  [[nodiscard]] JobStore& store() const { return site_.store(); }
  /// From any thread to the loop's.
  void later(std::function<void()> work) { site_.loop().post(std::move(work)); }
  void set_exposure_unknown(const std::string& job, bool is_unknown);
  /// The light of a machine whose print waits is switched off, as that of one that prints is.
  void darken(const Job& job);

  /// On the device's thread.
  void print(const std::string& job, std::stop_token stop);
  /// Whether the store says so now; if not, it is tried again. What the next start knows of this print begins there.
  [[nodiscard]] bool is_recorded_as_printing(const std::string& job);
  [[nodiscard]] Result<PrintRecord> attempt(const std::string& job, PrintControl& control, const std::stop_token& stop);
  /// Whether the job may go on its machine now; false: another part is on the platform, and the job waits.
  [[nodiscard]] bool take_platform(const Job& job, const MachineProfile& machine);

  /// Whether the disk has room for what the print will write; false: the job waits for it.
  [[nodiscard]] bool has_room(const Job& job);
  /// The job says why it waits, and is tried again.
  void wait_for_disk(const std::string& job, const Error& why);

  void wait_for_platform(const Job& job, const std::string& occupant);
  void try_again_later(const std::string& job);
  void on_progress(const std::string& job, const PrintProgress& progress);
  void on_ended(const std::string& job, const Result<PrintRecord>& record);
  /// What the start rule would say of the job now. Fails as start_case.
  [[nodiscard]] Result<StartRuling> ruling_on(const std::string& job);

  /// The control of the job's print, if it is under way.
  [[nodiscard]] std::shared_ptr<PrintControl> control_of(const std::string& job);
  /// Hands the command to the print under way; `done` is called once its journal has it.
  void pass_to_print(const Command& command, const std::shared_ptr<PrintControl>& control,
                     std::function<void(Result<Job>)> done);
  /// Keeps a word about a job that is not on its machine. Fails as keep_word does.
  [[nodiscard]] Result<void> keep(const Job& job, const PrintWord& word);
  /// Approves or resumes a job that is not on its machine, and puts it there.
  [[nodiscard]] Result<void> put_on_machine(const Job& job, const PrintWord& word);
  [[nodiscard]] Result<void> approve(const Job& job, const Command& command);
  /// Of a job that is not on its machine, or not yet.
  [[nodiscard]] Result<void> pause(const Job& job, const std::string& who);
  [[nodiscard]] Result<void> cancel(const Job& job, const std::string& who);

  Site& site_;
  StartPolicy at_start_;
  PlatformPolicy platform_policy_;
  bool start_on_approval_;
  Platforms platforms_;
  std::mutex mutex_;
  std::set<std::string> for_platform_;      ///< jobs that wait for an empty platform; guarded by mutex_
  std::set<std::string> exposure_unknown_;  ///< jobs whose next layer was perhaps exposed; guarded by mutex_
  /// Guarded by mutex_, which is also held while a word goes into the journal of a job that does not print.
  std::string printing_;
  std::shared_ptr<PrintControl> control_;  ///< of the job being printed; guarded by mutex_
  std::atomic<std::uint64_t> beats_ = 0;   ///< waits of the print under way; 0: none, or not so far yet
  Heartbeat beat_{std::chrono::seconds{30}};
  WorkQueue queue_;
};

}  // namespace telefab::fab
