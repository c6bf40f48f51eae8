// SPDX-License-Identifier: GPL-3.0-or-later
#include "fab_site.hpp"

#include <fmt/format.h>

#include <telefab/base/file.hpp>
#include <telefab/base/version.hpp>
#include <telefab/service/log.hpp>
#include <telefab/service/profile_choice.hpp>

namespace telefab::fab {
namespace {

constexpr const char* kThreeJs = "/usr/share/javascript/three/three.min.js";  // Debian libjs-three
constexpr std::uint64_t kMaxThreeJsBytes = 4U << 20U;
constexpr auto kDarkLookEvery = std::chrono::milliseconds{20};

}  // namespace

Result<void> serve_fab_site(const FabSiteConfig& config, const Clock& clock, std::stop_token stop) {
  if (config.fleet.is_any() && !is_job_id(config.fleet.name))
    return fail(
        ErrorCode::InvalidInput,
        "--fleet wants --fleet-name, a name of this fab that no other one of the fleet has: 1 to 64 of a-z, 0-9 "
        "and -");
  std::vector<MachineInstance> instances;
  const auto site = Site::open("telefab-fab", config.serve, clock, [&](ProfileCatalogue known) {
    auto inventory = open_inventory(config.instances, std::move(known));
    if (inventory) instances = std::move(inventory->instances);
    return std::move(inventory).map([](FabInventory&& each) { return std::move(each.profiles); });
  });
  if (!site) return tl::unexpected{site.error()};
  auto machines = FabMachines::of((*site)->profiles(), std::move(instances));
  if (!machines) return tl::unexpected{machines.error()};
  auto leases = LeaseBook::open((*site)->folder().path() / "fleet", clock);
  if (!leases) return tl::unexpected{leases.error()};
  for (const std::string& unreadable : (*leases)->unreadable()) log_warning(unreadable);
  FabSite work{**site, config, std::move(*machines), std::move(*leases)};
  if (auto served = (*site)->serve(work, std::move(stop)); !served) return served;
  log_line(
      "telefab-fab ends; every print by its own light is dark and is resumed at the next start, and what whole "
      "printers print goes on there");
  return {};
}

FabSite::FabSite(Site& site, const FabSiteConfig& config, FabMachines machines, std::unique_ptr<LeaseBook> leases)
    : SiteWork{site},
      start_on_approval_{config.start_on_approval},
      leases_{std::move(leases)},
      dispatcher_{site, config, std::move(machines), *leases_},
      planner_{site, config.planning, dispatcher_},
      intake_{site,
              SiteKeys{config.site_keys.empty() ? config.serve.tls_folder : config.site_keys},
              config.at_start,
              planner_,
              *leases_,
              config.fleet.is_any() ? JobIntake::InFleet::Yes : JobIntake::InFleet::No} {
  if (config.fleet.is_any()) fleet_ = std::make_unique<FleetAgent>(site, config.fleet, *leases_, dispatcher_);
}

void FabSite::resume(const Job& job) {
  const auto resumed = [&]() -> Result<void> {
    site().tracker().counters().begin(job.id, job.counters);
    if (is_before(job.state, JobState::AwaitingApproval)) return intake_.resume(job);
    if (job.state == JobState::AwaitingApproval || job.state == JobState::Ready) planner_.predict(job.id);
    return dispatcher_.resume(job);
  }();
  if (resumed) return;
  // Nothing lights of what cannot be read, and nothing of it is given up.
  if (!is_before(job.state, JobState::AwaitingApproval))
    site().tracker().move(job.id, JobState::Paused, resumed.error().what + "; telefab resume tries again");
  else
    log_warning(resumed.error().what, {job.id});
}

Hello FabSite::hello() {
  Machines known = to_machines(site().profiles(), "this fab");
  return {kProtocolVersion,
          Side::FabSite,
          fmt::format("telefab-fab {}", kVersion),
          std::move(known.machine_toml),
          start_on_approval_ ? "on-approval" : "automatic",
          std::move(known.resin_toml),
          std::move(known.print_toml),
          true};
}

void FabSite::on_site(const net::ConnectionPtr& connection) {
  serve_scan_site(site().loop(), connection, *this, intake_);
}

WebSite& FabSite::open_page(SignIn& sign_in, CommandPost post) {
  page_backend_ = std::make_unique<SitePageBackend>(
      store(), site().room(), site().folder(), site().profiles(), std::move(post),
      [this](const NewJob& upload, std::function<void(Result<Job>)> done) {
        site().loop().post([this, upload, done = std::move(done)] { done(intake_.take_upload(upload)); });
      },
      [this](const std::string& job, const HandList& supports, const std::string& who,
             std::function<void(Result<Job>)> done) {
        site().loop().post(
            [this, job, supports, who, done = std::move(done)] { done(planner_.plan_again(job, supports, who)); });
      },
      [this](const std::string& job) {
        return JobQuestions{dispatcher_.question_about(job), dispatcher_.platform_waited_for(job)};
      },
      MachineAsker{[this] { return dispatcher_.standing(); },
                   [this](std::string_view machine) { return dispatcher_.moment(machine); },
                   [this] { return dispatcher_.revision(); }});
  std::string three_js;
  if (const auto library = read_file(kThreeJs, kMaxThreeJsBytes))
    three_js.assign(reinterpret_cast<const char*>(library->data()), library->size());
  web_site_ = std::make_unique<FabWeb>(*page_backend_, sign_in, WebOptions{std::string{kVersion}, std::move(three_js)});
  return *web_site_;
}

void FabSite::begin(std::uint16_t port) {
  log_line(fmt::format("telefab-fab listens on port {}", port));
  if (fleet_) fleet_->begin(port);
}

void FabSite::end(std::function<void()> ended) {
  if (!dispatcher_.is_idle()) log_line("telefab-fab ends when the light of every print by its own light has ended");
  if (fleet_) fleet_->ask_to_end();
  planner_.ask_to_end();
  dispatcher_.ask_to_end();
  end_when_dark(std::move(ended));
}

void FabSite::end_when_dark(std::function<void()> ended) {
  if (dispatcher_.has_ended()) return ended();
  site().loop().after(kDarkLookEvery, [this, ended = std::move(ended)] { end_when_dark(ended); });
}

void FabSite::machines(std::function<void(Machines)> done) {
  Machines known = to_machines(site().profiles(), "this fab");
  known.standing = dispatcher_.standing();
  done(std::move(known));
}

Result<void> FabSite::may_submit(const Submit&) {
  return fail(ErrorCode::NotPermitted, "a fab takes layers, no scans: submit to a scan site");
}

Result<Job> FabSite::submit(const Submit& submit, const std::filesystem::path&, std::string_view) {
  return tl::unexpected{may_submit(submit).error()};
}

void FabSite::command(const Command& command, std::function<void(Result<Job>)> done) {
  if (command.command == JobCommand::Cleared) return done(dispatcher_.clear_platform(command.job));
  if (command.command == JobCommand::Forget) return done(forget(command.job));
  const auto job = store().find(command.job);
  if (!job) return done(job);
  dispatcher_.command(*job, command, [this, done = std::move(done)](Result<Job> answered) {
    // What is under way at its machine ends later, by its record.
    if (answered && answered->state == JobState::Cancelled) planner_.drop(answered->id);
    done(std::move(answered));
  });
}

Result<Job> FabSite::forget(const std::string& job) {
  if (const auto now = store().find(job); now && is_final(now->state) && planner_.drop(job))
    return fail(ErrorCode::Conflict, fmt::format("job {} is still worked on; forget it in a moment", job));
  return site().forget(job);
}

void FabSite::files(const std::string& job, std::function<void(Result<std::vector<FileEntry>>)> done) {
  const auto found = site().find(job);
  if (!found) return done(tl::unexpected{found.error()});
  auto files = files_of(found->folder / "plan");
  for (FileEntry& file : files_of(found->folder / "report")) files.push_back(std::move(file));
  done(std::move(files));
}

void FabSite::file(const std::string& job, const std::string& name,
                   std::function<void(Result<std::filesystem::path>)> done) {
  const auto found = site().find(job);
  if (!found) return done(tl::unexpected{found.error()});
  std::error_code error;
  for (const char* part : {"plan", "report"})
    if (const auto path = found->folder / part / name; std::filesystem::is_regular_file(path, error)) return done(path);
  done(fail(ErrorCode::NotFound, fmt::format("job {} has no file {}", job, name)));
}

}  // namespace telefab::fab
