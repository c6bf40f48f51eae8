// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <set>
#include <telefab/scan/daemon/serve_scan_site.hpp>
#include <telefab/service/log.hpp>
#include <telefab/service/site.hpp>

#include "fab_route.hpp"
#include "site_page_backend.hpp"
#include "site_staging_backend.hpp"
#include "slicer.hpp"

namespace telefab::scan {

/// The work of the scan site: clients' scans in, layers out to the fab, and the fab's news back. Stop order: page and
/// listener (Site), route, slicer.
class ScanSite final : public SiteWork {
 public:
  /// Everything but the addresses to listen on is checked when this returns. The site must outlive it.
  [[nodiscard]] static Result<std::unique_ptr<ScanSite>> open(Site& site, const ScanSiteConfig& config);
  ~ScanSite() override;

  void machines(std::function<void(Machines)> done) override;
  Result<void> may_submit(const Submit& submit) override;
  Result<Job> submit(const Submit& submit, const std::filesystem::path& upload, std::string_view owner) override;
  void command(const Command& command, std::function<void(Result<Job>)> done) override;
  Result<Job> forget(const std::string& job) override;
  void files(const std::string& job, std::function<void(Result<std::vector<FileEntry>>)> done) override;
  void file(const std::string& job, const std::string& name,
            std::function<void(Result<std::filesystem::path>)> done) override;

  void resume(const Job& job) override;
  Hello hello() override;
  void on_site(const net::ConnectionPtr& connection) override;
  WebSite& open_page(SignIn& sign_in, CommandPost post) override;
  void begin(std::uint16_t port) override;

 private:
  explicit ScanSite(Site& site) : SiteWork{site} {}
  [[nodiscard]] Result<void> start(const ScanSiteConfig& config);
  /// may_submit for a scan that wants so much of the disk, its layers with it.
  [[nodiscard]] Result<void> may_take(const Submit& submit, std::uint64_t bytes);
  /// A job of its own of a scan that is here, which goes into its folder.
  [[nodiscard]] Result<Job> take_scan(const Submit& submit, const NewJob& as, const std::filesystem::path& upload);
  /// A job is offered where it is to be printed.
  void bring(const Offer& offer, std::shared_ptr<SharedSpool> spool);
  [[nodiscard]] SlicerEvents slicer_events();
  [[nodiscard]] RouteEvents route_events();
  /// Those of where its jobs are printed; this site's own until that was reached once.
  [[nodiscard]] const ProfileCatalogue& known_profiles() const;
  /// The page chooses from the same.
  void show_profiles();
  /// Whose known_profiles() are.
  [[nodiscard]] std::string origin_of_profiles() const;
  /// Takes uploads that nobody has touched for long off the disk; asks itself every hour.
  void look_after_uploads();
  [[nodiscard]] Result<void> resume_unfinished(const Job& job);
  /// What a job is cut for, as it was when it was submitted: a later start may not have reached the fab yet.
  [[nodiscard]] Result<MachineProfile> profile_of(const Job& job, const std::filesystem::path& folder) const;
  void bring(const Offer& offer, const std::filesystem::path& folder);
  /// The job says why it waits, and is resumed again; nothing of it is lost.
  void wait_for_disk(const std::string& job, const Error& why);
  void on_job_changed(const Job& theirs);
  void on_kept(const std::string& job);
  /// Layers that the disk does not give now are asked for again; those that are not what was cut end the job.
  void on_unreadable(const std::string& job, const Error& why);
  /// The mark by which the fab is told, at once or later. Fails as write_file_atomically.
  [[nodiscard]] Result<void> mark_cancelled(const std::string& job, const std::string& who) const;
  /// A job that cannot go on here ends, and where it was brought to hears of it.
  void fail_everywhere(const std::string& job, const std::string& why);
  /// Brings the fab's reports and pictures of an ended job here, so that they can be had without the fab.
  void keep_reports(const std::string& job);
  void send_cancelled();
  [[nodiscard]] JobTracker& tracker() const { return site().tracker(); }
  [[nodiscard]] LiveCounters& counters() const { return site().tracker().counters(); }

  SpoolRegistry spools_;
  std::string id_prefix_;             ///< of its jobs; empty: in no fleet
  std::set<std::string> unreadable_;  ///< jobs whose spool is read again after a while
  std::unique_ptr<Slicer> slicer_;
  std::unique_ptr<FabRoute> route_;
  std::unique_ptr<UploadStore> uploads_;  ///< null where there is no page
  std::unique_ptr<SitePageBackend> page_backend_;
  std::unique_ptr<SiteStagingBackend> staging_backend_;
  std::unique_ptr<ScanWeb> web_site_;
};

}  // namespace telefab::scan
