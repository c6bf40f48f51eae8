// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <telefab/fab/daemon/serve_fab_site.hpp>
#include <telefab/fab/web/router.hpp>
#include <telefab/service/site.hpp>

#include "fleet_agent.hpp"
#include "job_dispatcher.hpp"
#include "job_intake.hpp"
#include "job_planner.hpp"
#include "site_page_backend.hpp"

namespace telefab::fab {

/// The work of the fab site: layers in from scan sites, planned, printed. What is to be done is done by the three it
/// holds, each handing jobs to the next; here they are wired to the site, to clients and to the page.
/// Threads: network (everything but the three below), planner, a device thread a machine, web. Stop order: page and
/// listener (Site), planner, devices.
class FabSite final : public SiteWork {
 public:
  /// The site must outlive it.
  FabSite(Site& site, const FabSiteConfig& config, FabMachines machines, std::unique_ptr<LeaseBook> leases);

  void machines(std::function<void(Machines)> done) override;
  Result<void> may_submit(const Submit& submit) override;
  Result<Job> submit(const Submit& submit, const std::filesystem::path& upload, std::string_view owner) override;
  void command(const Command& command, std::function<void(Result<Job>)> done) override;
  void files(const std::string& job, std::function<void(Result<std::vector<FileEntry>>)> done) override;
  void file(const std::string& job, const std::string& name,
            std::function<void(Result<std::filesystem::path>)> done) override;

  Result<Job> forget(const std::string& job) override;
  void resume(const Job& job) override;
  Hello hello() override;
  void on_site(const net::ConnectionPtr& connection) override;
  WebSite& open_page(SignIn& sign_in, CommandPost post) override;
  void begin(std::uint16_t port) override;
  bool is_alive() override { return dispatcher_.is_alive(); }
  /// The prints under way go dark, and their journals say so, before the site ends.
  void end(std::function<void()> ended) override;

 private:
  void end_when_dark(std::function<void()> ended);

  bool start_on_approval_;
  std::unique_ptr<LeaseBook> leases_;
  JobDispatcher dispatcher_;
  JobPlanner planner_;
  JobIntake intake_;
  std::unique_ptr<FleetAgent> fleet_;  ///< null: the fab is in none
  std::unique_ptr<SitePageBackend> page_backend_;
  std::unique_ptr<FabWeb> web_site_;
};

}  // namespace telefab::fab
