// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <map>
#include <optional>
#include <stop_token>
#include <telefab/machine/profile_catalogue.hpp>
#include <telefab/service/data_folder.hpp>
#include <telefab/service/disk_room.hpp>
#include <telefab/service/job_service.hpp>
#include <telefab/service/job_tracker.hpp>
#include <telefab/service/serve_options.hpp>
#include <telefab/service/web_page.hpp>

namespace telefab {

class SiteWork;

/// A job and the folder that holds all of it.
struct FoundJob {
  Job job;
  std::filesystem::path folder;
};

/// What every daemon is: a folder, its jobs, a loop, a listener, a page, news for the service manager, and the order in
/// which all of that begins and ends. What the jobs of a site go through is its SiteWork.
/// Threads: the loop's, but for find() and what its parts allow.
class Site {
 public:
  /// What of the profiles of --machines a site offers.
  using Offering = std::function<Result<ProfileCatalogue>(ProfileCatalogue known)>;
  /// Looks at everything that was given but the addresses to listen on. `program`: "telefab-fab". `offering`: empty:
  /// all. The clock must outlive the site. Fails as known_profiles, the offering, DataFolder::open, JobTracker::open
  /// and trust_of do.
  [[nodiscard]] static Result<std::unique_ptr<Site>> open(std::string program, const ServeOptions& options,
                                                          const Clock& clock, const Offering& offering = {});
  Site(const Site&) = delete;
  Site& operator=(const Site&) = delete;

  /// Goes on with the jobs that are not at their end, listens, shows the page, and serves until the stop is requested
  /// and the work has ended. The calling thread is the loop's. `work` must go before the site does. Fails, before
  /// anything is served, as JobStore, open_listener, sign_in_of and open_page do.
  [[nodiscard]] Result<void> serve(SiteWork& work, std::stop_token stop);

  [[nodiscard]] const std::string& program() const { return program_; }
  [[nodiscard]] const ServeOptions& options() const { return options_; }
  [[nodiscard]] const Clock& clock() const { return clock_; }
  /// Those of --machines that the site offers, with resins and prints.
  [[nodiscard]] const ProfileCatalogue& profiles() const { return profiles_; }
  /// Every machine as it prints where a job chooses nothing.
  [[nodiscard]] const std::vector<MachineProfile>& machines() const { return profiles_.machines(); }
  /// Null without --tls.
  [[nodiscard]] const std::shared_ptr<net::Trust>& trust() const { return trust_; }
  [[nodiscard]] const DataFolder& folder() const { return folder_; }
  [[nodiscard]] DiskRoom& room() { return *room_; }
  [[nodiscard]] net::Loop& loop() { return *loop_; }
  [[nodiscard]] JobTracker& tracker() { return *tracker_; }
  [[nodiscard]] JobStore& store() { return tracker_->store(); }
  /// Any thread. Fails: NotFound, StorageFailed.
  [[nodiscard]] Result<FoundJob> find(const std::string& job);
  /// Takes a job that has ended off the list and removes its folder; its as-built record is kept in records/. The job
  /// as it was. Fails: NotFound, Conflict (it has not ended), StorageFailed; then all is as before.
  [[nodiscard]] Result<Job> forget(const std::string& job);

 private:
  Site(std::string program, const ServeOptions& options, const Clock& clock, ProfileCatalogue profiles,
       DataFolder folder)
      : program_{std::move(program)},
        options_{options},
        clock_{clock},
        profiles_{std::move(profiles)},
        folder_{std::move(folder)} {}
  [[nodiscard]] Result<std::unique_ptr<WebServer>> open_page_of(SiteWork& work);
  void on_connection(SiteWork& work, const net::ConnectionPtr& connection);
  /// Forgets what has outlived --keep-days and --keep-gib; asks itself every hour. One folder a turn of the loop is
  /// measured, and one job forgotten, so that others are served in between.
  void look_at_retention(SiteWork& work);
  void measure(SiteWork& work, std::vector<std::string> jobs);
  void forget_outlived(SiteWork& work);
  void forget(SiteWork& work, std::vector<Outlived> gone);
  /// Asks itself every hour, and does nothing where nothing has changed.
  void back_up_store();
  /// Takes the reserve back once there is room for it again; asks itself every few seconds.
  void look_after_reserve();

  std::string program_;
  ServeOptions options_;
  const Clock& clock_;
  ProfileCatalogue profiles_;
  DataFolder folder_;
  std::shared_ptr<net::Trust> trust_;
  std::unique_ptr<DiskRoom> room_;
  std::unique_ptr<JobTracker> tracker_;  ///< outlives the loop, whose sessions may still note something
  std::unique_ptr<net::Loop> loop_;
  std::optional<SignIn> sign_in_;                     ///< of the page, whose thread alone uses it
  std::map<std::string, std::uint64_t> ended_bytes_;  ///< of folders, by job; only where --keep-gib is set
  std::uint64_t backed_up_revision_ = 0;
  net::Listener* listener_ = nullptr;  ///< while it serves
};

/// What one daemon does beside what every daemon does. Called on the loop's thread.
class SiteWork : public JobService {
 public:
  JobStore& store() final { return site_.store(); }
  std::filesystem::path incoming() final { return site_.folder().incoming(); }
  void expect_upload(const std::filesystem::path& upload, std::uint64_t missing_bytes) final {
    site_.room().expect(upload.filename(), missing_bytes);
  }
  void note(std::string_view who, std::string_view what) final { site_.tracker().note(who, what); }

  /// Goes on with a job that was not at its end when the site ended last.
  virtual void resume(const Job& job) = 0;
  /// Site::forget, once nothing works on the job any more.
  [[nodiscard]] virtual Result<Job> forget(const std::string& job) { return site_.forget(job); }
  /// What this site shows of itself to whoever calls.
  [[nodiscard]] virtual Hello hello() = 0;
  /// Another site, not a client, has called and is past its handshake.
  virtual void on_site(const net::ConnectionPtr& connection) = 0;
  /// What the page shows; it lives on until the work does, `sign_in` longer. `post` gives commands from the page's
  /// thread.
  [[nodiscard]] virtual WebSite& open_page(SignIn& sign_in, CommandPost post) = 0;
  /// The port is bound, and the loop is about to run.
  virtual void begin(std::uint16_t port) = 0;
  /// Whether threads beside the loop's go on, for the service manager.
  [[nodiscard]] virtual bool is_alive() { return true; }
  /// Asks all work to end; `ended` is called, here or later, once the loop may stop.
  virtual void end(std::function<void()> ended) { ended(); }

 protected:
  explicit SiteWork(Site& site) : site_{site} {}
  [[nodiscard]] Site& site() const { return site_; }

 private:
  Site& site_;
};

}  // namespace telefab
