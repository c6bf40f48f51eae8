// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <atomic>
#include <map>
#include <set>
#include <telefab/fab/daemon/serve_fab_site.hpp>
#include <telefab/fab/support/part_regions.hpp>
#include <telefab/fab/web/router.hpp>
#include <telefab/machine/machine_profile.hpp>
#include <telefab/service/client_session.hpp>
#include <telefab/service/job_tracker.hpp>
#include <telefab/service/live_counters.hpp>
#include <telefab/service/log.hpp>
#include <telefab/service/service_notifier.hpp>

#include <telefab/service/work_queue.hpp>
#include "platforms.hpp"
#include "print_orders.hpp"
#include "scan_session.hpp"
#include "site_keys.hpp"
#include "site_page_backend.hpp"

namespace telefab::fab {

/// The daemon: layers in from scan sites, planned, printed; commands and questions from clients and scan sites.
/// Threads: network (everything but the three below), planner, device, web. Stop order: web, listener, planner,
/// device, tracker.
class FabSite final : public JobService, public StackReceiver {
 public:
  /// Everything is checked and the port is bound when this returns.
  [[nodiscard]] static Result<std::unique_ptr<FabSite>> open(const FabSiteConfig& config, const Clock& clock);
  ~FabSite() override;
  /// Serves until the stop is requested. The calling thread is the loop's.
  [[nodiscard]] Result<void> run(std::stop_token stop);

  JobStore& store() override { return tracker_->store(); }
  Machines machines() override;
  Result<void> may_submit(const Submit& submit) override;
  std::filesystem::path incoming() override { return folder_.incoming(); }
  Result<Job> submit(const Submit& submit, const std::filesystem::path& upload, std::string_view owner) override;
  void command(const Command& command, std::function<void(Result<Job>)> done) override;
  void files(const std::string& job, std::function<void(Result<std::vector<FileEntry>>)> done) override;
  void file(const std::string& job, const std::string& name,
            std::function<void(Result<std::filesystem::path>)> done) override;
  void note(std::string_view who, std::string_view what) override;

  Result<std::shared_ptr<Intake>> take_offer(const Offer& offer, const net::Peer& peer) override;
  void received(const std::string& job, std::uint32_t layers, std::uint64_t bytes) override;
  void completed(const std::string& job) override;
  void broken(const std::string& job, const Error& why) override;

 private:
  FabSite(DataFolder folder, const Clock& clock, std::vector<MachineProfile> machines, FabSiteConfig config)
      : folder_{std::move(folder)},
        clock_{clock},
        machines_{std::move(machines)},
        config_{std::move(config)},
        site_keys_{config_.site_keys.empty() ? config_.serve.tls_folder : config_.site_keys},
        platforms_{folder_.path() / "platforms"} {}
  [[nodiscard]] Result<void> start();
  [[nodiscard]] Result<void> start_web();
  [[nodiscard]] Result<void> resume_unfinished(const Job& job);
  /// What a job that is planned may do by itself at a start.
  [[nodiscard]] Result<void> rule_at_start(const Job& job);
  /// The light of a machine whose print waits is switched off, as that of one that prints is.
  void darken(const Job& job);
  /// Makes the job whose layers write_upload has put on disk.
  [[nodiscard]] Result<Job> take_upload(const NewJob& upload);
  void on_connection(const net::ConnectionPtr& connection);
  void move(const std::string& job, JobState state, std::string_view message);
  void end_job(const std::string& job, JobState state, std::string_view message);
  void planned(const std::string& job, const std::string& hold_reason);
  void count_planned(const std::string& job, std::uint32_t done, std::uint32_t all);
  /// On the planner's and the device's thread.
  void plan(const std::string& job, std::stop_token stop);
  /// Of a job whose layers came in since the start; none of others.
  [[nodiscard]] std::shared_ptr<const PartRegions> take_analysed(const std::string& job, std::uint32_t layers);
  void print(const std::string& job, std::stop_token stop);
  void predict(const std::string& job, std::stop_token stop);
  /// Whether the print under way, if there is one, still looks at its devices.
  [[nodiscard]] bool is_printer_alive();
  /// A layer of the job was perhaps exposed, and nobody has decided yet.
  [[nodiscard]] bool is_exposure_unknown(const std::string& job);
  void set_exposure_unknown(const std::string& job, bool is_unknown);
  /// Hands the command to the print under way; `done` is called once its journal has it.
  void pass_to_print(const Command& command, const std::shared_ptr<PrintControl>& control,
                     std::function<void(Result<Job>)> done);
  /// Keeps a word about a job that is not on its machine. Fails as keep_word does.
  [[nodiscard]] Result<void> keep(const Job& job, const PrintWord& word);
  /// Approves or resumes a job that is not on its machine, and puts it there.
  [[nodiscard]] Result<void> put_on_machine(const Job& job, const PrintWord& word);
  /// Whether the job may go on its machine now; false: another part is on the platform, and the job waits.
  [[nodiscard]] bool take_platform(const Job& job, const MachineProfile& machine);
  void wait_for_platform(const Job& job, const std::string& occupant);
  /// An operator says that the platform of the machine is empty. The job whose part was on it.
  [[nodiscard]] Result<Job> clear_platform(const std::string& machine);
  [[nodiscard]] bool waits_for_platform(const std::string& job);
  [[nodiscard]] Result<void> approve(const Job& job, const Command& command);
  /// Of a job that is not on its machine, or not yet.
  [[nodiscard]] Result<void> pause(const Job& job, const std::string& who);
  [[nodiscard]] Result<void> cancel(const Job& job, const std::string& who);
  void on_print_progress(const std::string& job, const PrintProgress& progress);
  /// From any thread to the loop's.
  void later(std::function<void()> work) { loop_.post(std::move(work)); }

  struct Live {
    std::shared_ptr<Intake> intake;         ///< until the stack is whole
    std::shared_ptr<LayerStream> analysis;  ///< of its layers, likewise
    Nanoseconds send_began{};
  };

  DataFolder folder_;
  const Clock& clock_;
  std::vector<MachineProfile> machines_;
  FabSiteConfig config_;
  SiteKeys site_keys_;
  Platforms platforms_;
  std::unique_ptr<JobTracker> tracker_;
  net::Loop loop_;
  std::unique_ptr<LiveCounters> counters_;
  std::map<std::string, Live> live_;
  std::mutex analysed_mutex_;
  std::map<std::string, std::shared_ptr<LayerStream>> analysed_;  ///< of jobs to be planned; guarded by analysed_mutex_
  std::mutex control_mutex_;
  std::set<std::string> for_platform_;      ///< jobs that wait for an empty platform; guarded by control_mutex_
  std::set<std::string> exposure_unknown_;  ///< jobs whose next layer was perhaps exposed; guarded by control_mutex_
  /// Guarded by control_mutex_, which is also held while a word goes into the journal of a job that does not print.
  std::string printing_;
  std::shared_ptr<PrintControl> control_;       ///< of the job being printed; guarded by control_mutex_
  std::atomic<std::uint64_t> print_beats_ = 0;  ///< waits of the print under way; 0: none, or not so far yet
  Heartbeat print_beat_{std::chrono::seconds{30}};
  std::unique_ptr<WorkQueue> predictor_;  ///< of accuracy pictures, behind everything else
  std::unique_ptr<WorkQueue> planner_;
  std::unique_ptr<WorkQueue> device_;
  std::unique_ptr<net::Listener> listener_;
  std::unique_ptr<SitePageBackend> page_backend_;
  std::unique_ptr<FabWeb> web_site_;
  std::unique_ptr<WebServer> web_;
};

}  // namespace telefab::fab
