// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <telefab/scan/daemon/serve_scan_site.hpp>
#include <telefab/service/client_session.hpp>
#include <telefab/service/job_tracker.hpp>
#include <telefab/service/live_counters.hpp>
#include <telefab/service/log.hpp>
#include <telefab/service/service_notifier.hpp>

#include "fab_link.hpp"
#include "site_page_backend.hpp"
#include "slicer.hpp"

namespace telefab::scan {

/// The daemon: clients' scans in, layers out to the fab, and the fab's news back. Stop order: web, listener, link,
/// slicer, tracker.
class ScanSite final : public JobService {
 public:
  /// Everything is checked and the port is bound when this returns.
  [[nodiscard]] static Result<std::unique_ptr<ScanSite>> open(const ScanSiteConfig& config, const Clock& clock);
  ~ScanSite() override;
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

 private:
  ScanSite(DataFolder folder, const Clock& clock, std::vector<MachineProfile> own_machines)
      : folder_{std::move(folder)}, clock_{clock}, own_machines_{std::move(own_machines)} {}
  [[nodiscard]] Result<void> start(const ScanSiteConfig& config);
  [[nodiscard]] Result<void> start_web(const ServeOptions& options);
  void on_connection(const net::ConnectionPtr& connection);
  [[nodiscard]] SlicerEvents slicer_events();
  [[nodiscard]] FabLinkEvents link_events();
  [[nodiscard]] const std::vector<MachineProfile>& known_machines() const;
  [[nodiscard]] Result<void> resume_unfinished(const Job& job);
  void end_job(const std::string& job, JobState state, std::string_view message);
  void on_job_changed(const Job& theirs);
  void on_kept(const std::string& job);
  void move(const std::string& job, JobState state, std::string_view message);
  /// Brings the fab's reports and pictures of an ended job here, so that they can be had without the fab.
  void keep_reports(const std::string& job);
  void send_cancelled();

  DataFolder folder_;
  const Clock& clock_;
  std::vector<MachineProfile> own_machines_;
  std::string fab_;
  std::unique_ptr<JobTracker> tracker_;
  net::Loop loop_;
  std::unique_ptr<LiveCounters> counters_;
  std::map<std::string, Nanoseconds> send_began_;  ///< of the jobs under way
  SpoolRegistry spools_;
  std::unique_ptr<Slicer> slicer_;
  std::unique_ptr<FabLink> link_;
  std::unique_ptr<net::Listener> listener_;
  std::unique_ptr<SitePageBackend> page_backend_;
  std::unique_ptr<ScanWeb> web_site_;
  std::unique_ptr<WebServer> web_;
};

}  // namespace telefab::scan
