// SPDX-License-Identifier: GPL-3.0-or-later
#include "scan_site.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <fstream>
#include <span>
#include <telefab/base/file.hpp>
#include <telefab/base/version.hpp>
#include <telefab/job/slice_parameters.hpp>
#include <telefab/scan/formats/read_cloud.hpp>
#include <telefab/scan/slicing/job_parameters.hpp>
#include <telefab/service/profile_choice.hpp>
#include <telefab/service/saved_message.hpp>
#include <telefab/transfer/second_name.hpp>

#include "fleet_route.hpp"
#include "site_key.hpp"

namespace telefab::scan {
namespace {

/// Written into a job's folder when it was cancelled here and the fab has not heard of it yet.
constexpr const char* kCancelMark = "tell-cancelled";
constexpr const char* kThreeJs = "/usr/share/javascript/three/three.min.js";  // Debian libjs-three
constexpr std::uint64_t kMaxThreeJsBytes = 8U << 20U;
constexpr auto kUploadsLookEvery = std::chrono::hours{1};
constexpr const char* kProfile = "machine.toml";  ///< in a job's folder
constexpr std::uint64_t kMaxProfileBytes = 1U << 20U;
constexpr std::size_t kLongestSiteName = 24;  ///< begins the ids of its jobs, to which fabs and copies add
constexpr const char* kOwnProfiles = "this scan site; the fab was not reached yet";

/// Refuses what is surely no scan before there is a job of it.
Result<void> check_scan(const std::filesystem::path& upload, const std::string& name) {
  std::array<char, 4096> beginning{};
  std::ifstream file{upload, std::ios::binary};
  file.read(beginning.data(), beginning.size());
  if (file.bad()) return fail(ErrorCode::StorageFailed, fmt::format("cannot read {} again", name));
  return check_may_be_scan(std::as_bytes(std::span{beginning}.first(static_cast<std::size_t>(file.gcount()))), name);
}

/// Jobs go either to a fab or to a fleet, and a fleet wants a name that its fabs can keep apart.
Result<void> check_way(const ScanSiteConfig& config) {
  const FleetMembership& fleet = config.fleet;
  if (!fleet.is_any()) {
    if (config.fab.empty())
      return fail(ErrorCode::InvalidInput, "say where jobs are printed: --fab HOST:PORT, or --fleet and --fleet-name");
    if (!fleet.name.empty()) return fail(ErrorCode::InvalidInput, "--fleet-name: there is no --fleet");
    return {};
  }
  if (!config.fab.empty())
    return fail(ErrorCode::InvalidInput, "--fab and --fleet: jobs are printed by a fab or by a fleet; leave one out");
  if (!is_job_id(fleet.name) || fleet.name.size() > kLongestSiteName)
    return fail(ErrorCode::InvalidInput,
                fmt::format("--fleet-name: give this site a name that no other of the fleet has: 1 to {} of a-z, 0-9 "
                            "and -",
                            kLongestSiteName));
  return {};
}

}  // namespace

Result<void> serve_scan_site(const ScanSiteConfig& config, const Clock& clock, std::stop_token stop) {
  const auto site = Site::open("telefab-scan", config.serve, clock);
  if (!site) return tl::unexpected{site.error()};
  const auto work = ScanSite::open(**site, config);
  if (!work) return tl::unexpected{work.error()};
  if (auto served = (*site)->serve(**work, std::move(stop)); !served) return served;
  log_line("telefab-scan ends");
  return {};
}

Result<std::unique_ptr<ScanSite>> ScanSite::open(Site& site, const ScanSiteConfig& config) {
  std::unique_ptr<ScanSite> work{new ScanSite{site}};
  if (auto started = work->start(config); !started) return tl::unexpected{started.error()};
  return work;
}

Result<void> ScanSite::start(const ScanSiteConfig& config) {
  if (auto ok = check_way(config); !ok) return ok;
  auto key = site_key(site().options(), site().folder().path());
  if (!key) return tl::unexpected{key.error()};
  slicer_ = std::make_unique<Slicer>(spools_, site().clock(), *key, slicer_events());
  if (!config.fleet.is_any()) {
    const auto fab = net::endpoint_from_text(config.fab);
    if (!fab) return fail_in("--fab", fab.error());
    net::ConnectOptions options{*fab, site().trust(), net::Role::FabSite, {}};
    options.expected_name = config.fab_certificate.empty() ? fab->host : config.fab_certificate;
    route_ = std::make_unique<OneFab>(site().loop(), std::move(options), *key, route_events());
  } else {
    id_prefix_ = config.fleet.name + "-";
    const FleetMembership& fleet = config.fleet;
    FleetRoute::Options options{[fleet, &clock = site().clock()] { return fleet.opened(clock); },
                                fleet.where.empty() ? "the fleet" : fleet.where, fleet.name, *key, site().trust()};
    route_ = std::make_unique<FleetRoute>(site().loop(), std::move(options), route_events());
  }
  if (!site().options().web.empty()) {
    auto uploads = UploadStore::open(site().folder().path() / "uploads", {.most_bytes = kMaxScanBytes}, site().clock());
    if (!uploads) return tl::unexpected{uploads.error()};
    uploads_ = std::move(*uploads);
  }
  tracker().on_end([this](const std::string& job) {
    route_->forget(job);
    spools_.close(job);
  });
  return {};
}

ScanSite::~ScanSite() {
  route_.reset();
  slicer_.reset();
}

WebSite& ScanSite::open_page(SignIn& sign_in, CommandPost post) {
  page_backend_ = std::make_unique<SitePageBackend>(
      store(), site().room(), site().folder(), spools_,
      LinkView{route_->address(), route_->is_fleet(), false, "not tried yet"}, std::move(post),
      [this](const std::string& job, const std::string& name, auto done) {
        site().loop().post([this, job, name, done = std::move(done)]() mutable { file(job, name, std::move(done)); });
      });
  staging_backend_ = std::make_unique<SiteStagingBackend>(
      *uploads_, site().room(), site().folder().incoming(), site().folder().path() / "waiting",
      [this](const Submit& asked, const std::filesystem::path& file, const std::string& who,
             std::function<void(Result<Job>)> done) {
        site().loop().post([this, asked, file, who, done = std::move(done)] {
          // The scan is here already, under this name or another.
          if (const auto may = may_take(asked, asked.size_bytes); !may) return done(tl::unexpected{may.error()});
          done(submit(asked, file, who));
        });
      },
      [this](const std::string& who, const std::string& what) {
        site().loop().post([this, who, what] { note(who, what); });
      });
  show_profiles();
  look_after_uploads();
  std::string three_js;
  if (const auto library = read_file(kThreeJs, kMaxThreeJsBytes))
    three_js.assign(reinterpret_cast<const char*>(library->data()), library->size());
  web_site_ = std::make_unique<ScanWeb>(*page_backend_, *staging_backend_, sign_in,
                                        WebOptions{std::string{kVersion}, std::move(three_js)});
  return *web_site_;
}

void ScanSite::show_profiles() {
  if (!staging_backend_) return;
  staging_backend_->set_profiles(std::make_shared<const ProfileCatalogue>(known_profiles()), origin_of_profiles());
}

void ScanSite::look_after_uploads() {
  staging_backend_->remove_outlived();
  site().loop().after(kUploadsLookEvery, [this] { look_after_uploads(); });
}

void ScanSite::begin(std::uint16_t port) {
  log_line(fmt::format("telefab-scan listens on port {} and sends to {}", port, route_->name()));
  route_->start();
}

Hello ScanSite::hello() { return {kProtocolVersion, Side::ScanSite, fmt::format("telefab-scan {}", kVersion), {}, {}}; }

void ScanSite::on_site(const net::ConnectionPtr& connection) {
  connection->close(to_frame(Fault{{}, {ErrorCode::ProtocolBroken, "handshake: only clients call a scan site"}, {}}));
}

const ProfileCatalogue& ScanSite::known_profiles() const {
  const ProfileCatalogue* theirs = route_->profiles();
  return theirs != nullptr && !theirs->machines().empty() ? *theirs : site().profiles();
}

std::string ScanSite::origin_of_profiles() const {
  return &known_profiles() == &site().profiles() ? kOwnProfiles : route_->name();
}

void ScanSite::machines(std::function<void(Machines)> done) {
  route_->machines([known = to_machines(known_profiles(), origin_of_profiles()),
                    done = std::move(done)](Result<std::vector<MachineStatus>> standing) mutable {
    if (standing)
      known.standing = std::move(*standing);
    else
      known.why_unknown = standing.error().what;
    done(std::move(known));
  });
}

Result<void> ScanSite::may_submit(const Submit& submit) {
  const auto wishes = job_wishes_from(submit.machine, submit.parameters);
  if (!wishes) return tl::unexpected{wishes.error()};
  // The scan itself, and at most as much again for the layers of each copy.
  return may_take(submit, (1 + std::uint64_t{wishes->copies}) * submit.size_bytes);
}

Result<void> ScanSite::may_take(const Submit& submit, std::uint64_t bytes) {
  const auto machine = profile_of_job(known_profiles(), route_->profile_of(submit.machine), submit.parameters);
  if (!machine) return tl::unexpected{machine.error()};
  const auto parameters = job_parameters_from(submit.parameters, *machine);
  if (!parameters) return tl::unexpected{parameters.error()};
  const auto asked = slice_parameters_from_json(submit.parameters);
  if (!asked) return tl::unexpected{asked.error()};
  const auto wishes = job_wishes_from(submit.machine, submit.parameters);
  if (!wishes) return tl::unexpected{wishes.error()};
  if (const std::string of_fleet = fleet_options_of(*asked); !route_->is_fleet() && !of_fleet.empty())
    return fail(ErrorCode::InvalidInput,
                fmt::format("{}: of fleets alone, and this site's jobs are printed by {}", of_fleet, route_->name()));
  // What is known before the scan was read; its other sides come when it is cut.
  if (const auto& height_mm = parameters->slice.placement.height_mm;
      height_mm && *height_mm > machine->platform.z_travel_mm)
    return fail(ErrorCode::InvalidInput,
                fmt::format("{} would be {:g} mm high, and {} travels {:g} mm; give --height-mm {:g} or less, or --fit",
                            submit.name, *height_mm, machine->name, machine->platform.z_travel_mm,
                            machine->platform.z_travel_mm));
  if (const auto room = site().room().check(bytes); !room)
    return fail(room.error().code, fmt::format("the scan site has no room for {}{}: {}", submit.name,
                                               room.error().code == ErrorCode::TooLarge ? "" : " now, submit it later",
                                               room.error().what));
  return {};
}

Result<Job> ScanSite::submit(const Submit& submit, const std::filesystem::path& upload, std::string_view owner) {
  if (auto may_be = check_scan(upload, submit.name); !may_be) return tl::unexpected{may_be.error()};
  const auto wishes = job_wishes_from(submit.machine, submit.parameters);
  if (!wishes) return tl::unexpected{wishes.error()};
  const NewJob first{{}, submit.name, submit.machine, submit.parameters, std::string{owner}, id_prefix_};
  auto job = take_scan(submit, first, upload);
  if (!job) return job;
  const auto folder = site().folder().job(job->id);
  for (std::uint32_t copy = 2; folder && copy <= wishes->copies; ++copy) {
    NewJob next = first;
    next.id = fmt::format("{}-c{}", job->id, copy);
    // The scan has a second name for each: it is kept while one of them is.
    const auto second = site().folder().incoming() / *next.id;
    auto named = give_second_name(*folder / "scan", second);
    if (named && !*named)
      named = fail(ErrorCode::StorageFailed, "the disk has no second names for files; submit it once for each copy");
    auto made = named ? take_scan(submit, next, second) : Result<Job>{tl::unexpected{named.error()}};
    if (!made)
      return fail(made.error().code, fmt::format("{} of {} copies were taken, as {} and behind it: {}", copy - 1,
                                                 wishes->copies, job->id, made.error().what));
  }
  return store().find(job->id);
}

Result<Job> ScanSite::take_scan(const Submit& submit, const NewJob& as, const std::filesystem::path& upload) {
  auto job = store().create(as);
  if (!job) return job;
  note(as.owner, fmt::format("submit {} {} for {} {} sha256 {}", job->id, submit.name, submit.machine,
                             submit.parameters, to_hex(submit.content)));
  const auto folder = site().folder().job(job->id);
  if (!folder) return tl::unexpected{folder.error()};
  std::error_code error;
  std::filesystem::rename(upload, *folder / "scan", error);
  if (error) {
    tracker().end(job->id, JobState::Failed, "the scan could not be kept: " + error.message());
    return fail(ErrorCode::StorageFailed, fmt::format("cannot keep {}: {}", submit.name, error.message()));
  }
  JobCounters begun = job->counters;
  begun.scan_bytes = submit.size_bytes;
  if (auto kept = store().set_counters(job->id, begun); !kept) {
    tracker().end(job->id, JobState::Failed, "the job could not be kept: " + kept.error().what);
    return tl::unexpected{kept.error()};
  }
  counters().begin(job->id, begun);
  resume(*job);
  return store().find(job->id);
}

void ScanSite::resume(const Job& job) {
  auto taken = resume_unfinished(job);
  if (!taken && taken.error().code == ErrorCode::StorageFailed) return wait_for_disk(job.id, taken.error());
  if (!taken) tracker().end(job.id, JobState::Failed, taken.error().what);
}

Result<void> ScanSite::resume_unfinished(const Job& job) {
  auto folder = site().folder().job(job.id);
  if (!folder) return tl::unexpected{folder.error()};
  counters().begin(job.id, job.counters);
  tracker().begin_stage(job.id, JobStage::Send);
  auto spool = spools_.of(job.id, *folder);
  if (!spool) return tl::unexpected{spool.error()};
  if (const auto offer = saved_offer(*folder)) bring(*offer, *spool);
  if ((*spool)->with([](const ChunkSpool& each) { return each.finished().has_value(); })) return {};
  auto machine = profile_of(job, *folder);
  if (!machine) return tl::unexpected{machine.error()};
  std::string asked = route_->asked_of_fab(job.machine, *machine);
  slicer_->add({job.id, job.name, job.owner, job.parameters, std::move(asked), std::move(*machine), *folder});
  return {};
}

void ScanSite::bring(const Offer& offer, std::shared_ptr<SharedSpool> spool) {
  const auto job = store().find(offer.job);
  if (!job) return;
  const auto wishes = job_wishes_from(job->machine, job->parameters);
  if (!wishes) return fail_everywhere(offer.job, wishes.error().what);
  route_->add(offer, std::move(spool), *wishes);
}

Result<MachineProfile> ScanSite::profile_of(const Job& job, const std::filesystem::path& folder) const {
  const auto kept = read_file(folder / kProfile, kMaxProfileBytes);
  if (kept)
    return machine_profile_from_toml({reinterpret_cast<const char*>(kept->data()), kept->size()},
                                     "what job " + job.id + " is cut for");
  if (kept.error().code != ErrorCode::NotFound) return tl::unexpected{kept.error()};
  auto machine = profile_of_job(known_profiles(), route_->profile_of(job.machine), job.parameters);
  if (machine)
    if (auto written = write_file_atomically(folder / kProfile, to_toml(*machine)); !written)
      return tl::unexpected{written.error()};
  return machine;
}

SlicerEvents ScanSite::slicer_events() {
  // From the slicer's thread to the loop's.
  return {[this](const std::string& job) {
            site().loop().post([this, job] { tracker().move(job, JobState::Slicing, ""); });
          },
          [this](const std::string& job, const Offer& offer) {
            site().loop().post([this, job, offer] {
              const auto folder = site().folder().job(job);
              if (!folder) return;
              if (!counters().change(job, [&](JobCounters& c) { c.layers = offer.header.layer_count; })) return;
              tracker().begin_stage(job, JobStage::Send);
              if (auto spool = spools_.of(job, *folder)) bring(offer, *spool);
            });
          },
          [this](const std::string& job, std::uint32_t layers) {
            site().loop().post([this, job, layers] {
              if (counters().change(job, [&](JobCounters& c) { c.layers_sliced = std::max(c.layers_sliced, layers); }))
                route_->pump(job);
            });
          },
          [this](const std::string& job, const Result<double>& seconds) {
            site().loop().post([this, job, seconds] {
              if (!counters().contains(job)) return;
              if (!seconds) {
                // A disk that is full or fails keeps the job waiting; what is cut already is in its spool.
                if (seconds.error().code == ErrorCode::StorageFailed) return wait_for_disk(job, seconds.error());
                if (seconds.error().code == ErrorCode::Cancelled)
                  return tracker().end(job, JobState::Cancelled, seconds.error().what);
                return fail_everywhere(job, seconds.error().what);
              }
              tracker().set_stage_seconds(job, JobStage::Slice, *seconds);
              tracker().move(job, JobState::Sending, route_->why_waiting(job));
              route_->pump(job);
            });
          }};
}

void ScanSite::wait_for_disk(const std::string& job, const Error& why) {
  if (const auto now = store().find(job)) tracker().wait_for_disk(job, now->state, why);
  site().loop().after(site().options().retry_every, [this, job] {
    if (const auto now = store().find(job); now && !is_final(now->state)) resume(*now);
  });
}

RouteEvents ScanSite::route_events() {
  RouteEvents events;
  events.changed = [this](const std::string& what, bool is_up, const std::string& why) {
    log_line(is_up ? what + " is reached" : fmt::format("{}: {}", what, why));
    if (page_backend_) page_backend_->set_link(is_up, why);
    show_profiles();
    if (is_up) send_cancelled();
    for (const std::string& job : counters().jobs())
      if (const auto now = store().find(job); now && now->state == JobState::Sending)
        tracker().move(job, JobState::Sending, route_->why_waiting(job));
  };
  events.standing = [this](std::string json) {
    if (page_backend_) page_backend_->set_fleet(std::move(json));
  };
  events.reached = [this] { send_cancelled(); };
  events.jobs.acknowledged = [this](const std::string& job, std::uint32_t layers, std::uint64_t bytes) {
    counters().change(job, [&](JobCounters& c) {
      c.layers_sent = std::max(c.layers_sent, layers);
      c.wire_bytes += bytes;
    });
  };
  events.jobs.kept = [this](const std::string& job) { on_kept(job); };
  events.jobs.job_changed = [this](const Job& theirs) { on_job_changed(theirs); };
  events.jobs.refused = [this](const std::string& job, const Error& why) {
    slicer_->cancel(job);
    tracker().end(job, JobState::Failed, "the fab refused it: " + why.what);
  };
  events.jobs.unreadable = [this](const std::string& job, const Error& why) { on_unreadable(job, why); };
  events.jobs.deferred = [this](const std::string& job, const std::string&) {
    const auto now = store().find(job);
    if (!now || is_final(now->state) || is_before(now->state, JobState::Slicing)) return;
    const std::string why = route_->why_waiting(job);
    // Behind that a print says itself what it is at, unless its fab cannot.
    if (!why.empty() || !is_before(JobState::Sending, now->state)) tracker().move(job, now->state, why);
  };
  events.taken_back = [this](const std::string& job, const std::string& why) { tracker().send_again(job, why); };
  events.ended = [this](const std::string& job, JobState end, const std::string& message) {
    if (!counters().contains(job)) return;
    slicer_->cancel(job);
    keep_reports(job);
    if (end == JobState::Done) tracker().move(job, JobState::Printing, "");
    tracker().end(job, end, message);
  };
  return events;
}

void ScanSite::on_kept(const std::string& job) {
  const auto now = store().find(job);
  if (!counters().contains(job) || !now || is_before(JobState::Sending, now->state)) return;
  tracker().end_stage(job, JobStage::Send);
  tracker().move(job, JobState::Planning, "");
}

void ScanSite::on_unreadable(const std::string& job, const Error& why) {
  const auto now = store().find(job);
  if (!now || is_final(now->state)) return;
  if (why.code == ErrorCode::NotTrusted) return fail_everywhere(job, why.what + "; submit the scan again");
  if (!unreadable_.insert(job).second) return;
  tracker().wait_for_disk(job, now->state, why);
  site().loop().after(site().options().retry_every, [this, job] {
    unreadable_.erase(job);
    const auto still = store().find(job);
    if (!still || is_final(still->state)) return;
    tracker().move(job, still->state, route_->why_waiting(job));
    route_->pump(job);
  });
}

void ScanSite::fail_everywhere(const std::string& job, const std::string& why) {
  if (route_->knows(job))
    if (auto marked = mark_cancelled(job, "scan-site"); !marked) log_warning(marked.error().what, {job});
  slicer_->cancel(job);
  tracker().end(job, JobState::Failed, why);
  send_cancelled();
}

Result<void> ScanSite::mark_cancelled(const std::string& job, const std::string& who) const {
  const auto folder = site().folder().job(job);
  if (!folder) return tl::unexpected{folder.error()};
  return write_file_atomically(*folder / kCancelMark, who + "\n");
}

void ScanSite::on_job_changed(const Job& theirs) {
  const bool is_live = counters().change(theirs.id, [&](JobCounters& c) {
    c.print_layers = theirs.counters.print_layers;
    c.layers_planned = theirs.counters.layers_planned;
    c.layers_printed = theirs.counters.layers_printed;
  });
  if (!is_live || is_before(theirs.state, JobState::Planning)) return;
  if (auto kept = store().set_instance(theirs.id, theirs.instance); !kept)
    log_warning(kept.error().what, {theirs.id});  // shown only; the next change tells it again
  for (const StageSeconds& stage : theirs.stages)
    if (stage.stage == JobStage::Plan || stage.stage == JobStage::Print)
      tracker().set_stage_seconds(theirs.id, stage.stage, stage.seconds);
  // What the fab did while the line was down, or between two looks, is not told step by step: a pause that ended in a
  // finished print went through printing.
  if (theirs.state == JobState::Done) tracker().move(theirs.id, JobState::Printing, "");
  if (is_final(theirs.state)) {
    keep_reports(theirs.id);
    return tracker().end(theirs.id, theirs.state, theirs.message);
  }
  tracker().move(theirs.id, theirs.state, theirs.message);
}

void ScanSite::keep_reports(const std::string& job) {
  files(job, [this, job](const Result<std::vector<FileEntry>>& list) {
    if (!list) return;
    for (const FileEntry& each : *list)
      file(job, each.name, [](const Result<std::filesystem::path>&) {});  // what fails is fetched when it is asked for
  });
}

void ScanSite::command(const Command& command, std::function<void(Result<Job>)> done) {
  if (command.command == JobCommand::Forget) return done(forget(command.job));
  if (command.command == JobCommand::Cleared)
    return done(fail(ErrorCode::Conflict, "platforms stand at the fab: telefab cleared MACHINE --site FAB"));
  const auto job = store().find(command.job);
  if (!job) return done(job);
  if (is_final(job->state))
    return done(fail(ErrorCode::Conflict, fmt::format("job {} is {} already", job->id, name_of(job->state))));
  if (command.command == JobCommand::Cancel) {
    const bool is_known_there = route_->knows(job->id);
    // What could not be kept is not answered as done: a restart would go on with the job, here or at the fab.
    if (auto kept = store().add_event(job->id, fmt::format("cancel asked by {}", command.who)); !kept)
      return done(tl::unexpected{kept.error()});
    if (is_known_there)
      if (auto kept = mark_cancelled(job->id, command.who); !kept) return done(tl::unexpected{kept.error()});
    slicer_->cancel(job->id);
    const bool waits = is_known_there && !route_->is_up();
    tracker().end(job->id, JobState::Cancelled,
                  fmt::format("by {}{}", command.who,
                              waits ? fmt::format("; {} will be told as soon as it is reached", route_->name()) : ""));
    send_cancelled();
    return done(store().find(job->id));
  }
  const auto fab = route_->fab_of(job->id);
  if (!fab || !route_->knows(job->id) || is_before(job->state, JobState::Planning))
    return done(fail(ErrorCode::Conflict, fmt::format("job {} is {}; there is no print to {} yet", job->id,
                                                      name_of(job->state), name_of(command.command))));
  Command forwarded = command;
  forwarded.job = fab->id;
  forwarded.request = fab->link->next_request();
  fab->link->ask(forwarded.request, forwarded, [this, id = job->id, done = std::move(done)](Result<Message> answer) {
    if (!answer) {
      done(tl::unexpected{answer.error()});
    } else {
      if (auto* jobs = std::get_if<Jobs>(&*answer); jobs && jobs->jobs.size() == 1) {
        jobs->jobs.front().id = id;
        on_job_changed(jobs->jobs.front());
      }
      done(store().find(id));
    }
    return true;
  });
}

Result<Job> ScanSite::forget(const std::string& job) {
  if (const auto now = store().find(job); now && is_final(now->state) && slicer_->cancel(job))
    return fail(ErrorCode::Conflict, fmt::format("job {} is still worked on; forget it in a moment", job));
  return site().forget(job);
}

void ScanSite::send_cancelled() {
  std::error_code error;
  for (const auto& entry : std::filesystem::directory_iterator{site().folder().path() / "jobs", error}) {
    const auto mark = entry.path() / kCancelMark;
    if (!std::filesystem::exists(mark, error)) continue;
    std::string who;
    std::getline(std::ifstream{mark}, who);
    route_->cancel(entry.path().filename().string(), who, [mark](const Result<void>& cancelled) {
      std::error_code ignored;  // asked twice at worst
      if (cancelled) std::filesystem::remove(mark, ignored);
    });
  }
}

void ScanSite::files(const std::string& job, std::function<void(Result<std::vector<FileEntry>>)> done) {
  const auto found = site().find(job);
  if (!found) return done(tl::unexpected{found.error()});
  auto own = files_of(found->folder / "report");
  const auto fab = route_->fab_of(job);
  if (!fab) return done(std::move(own));
  const RequestId request = fab->link->next_request();
  fab->link->ask(request, AskFiles{request, fab->id},
                 [own = std::move(own), done = std::move(done)](Result<Message> answer) mutable {
                   // Without the fab there is what was fetched before.
                   if (answer)
                     if (const auto* theirs = std::get_if<Files>(&*answer))
                       for (const FileEntry& file : theirs->files) {
                         std::erase_if(own, [&](const FileEntry& each) { return each.name == file.name; });
                         own.push_back(file);
                       }
                   std::sort(own.begin(), own.end(),
                             [](const FileEntry& a, const FileEntry& b) { return a.name < b.name; });
                   done(std::move(own));
                   return true;
                 });
}

void ScanSite::file(const std::string& job, const std::string& name,
                    std::function<void(Result<std::filesystem::path>)> done) {
  const auto found = site().find(job);
  if (!found) return done(tl::unexpected{found.error()});
  const auto kept = found->folder / "report" / name;
  const auto fab = route_->fab_of(job);
  const bool is_reached = fab && fab->link->is_up();
  if (name == "slice.json" || !is_reached) {
    std::error_code error;
    if (std::filesystem::is_regular_file(kept, error)) return done(kept);
    return done(fail(ErrorCode::NotFound, fmt::format("job {} has no file {} here{}", job, name,
                                                      is_reached ? "" : ", and the fab is not reachable now")));
  }
  if (auto made = make_folder(kept.parent_path()); !made) return done(tl::unexpected{made.error()});
  // Fetched again each time: the fab may have gone on.
  struct Arriving {
    std::ofstream file;
    std::filesystem::path path;
    std::uint64_t got = 0;
  };
  const RequestId request = fab->link->next_request();
  auto arriving = std::make_shared<Arriving>();
  arriving->path = site().folder().incoming() / fmt::format("fetched-{}", static_cast<std::uint64_t>(request));
  arriving->file.open(arriving->path, std::ios::binary);
  fab->link->ask(request, AskFile{request, fab->id, name},
                 [arriving, kept, done = std::move(done)](Result<Message> answer) {
                   std::error_code failed;
                   const auto give_up = [&](Error why) {
                     std::filesystem::remove(arriving->path, failed);
                     done(tl::unexpected{std::move(why)});
                     return true;
                   };
                   if (!answer) return give_up(answer.error());
                   const auto* block = std::get_if<FileBlock>(&*answer);
                   if (!block || block->offset_bytes != arriving->got)
                     return give_up({ErrorCode::ProtocolBroken, "the fab sent something else than the file"});
                   arriving->file.write(reinterpret_cast<const char*>(block->content.data()),
                                        static_cast<std::streamsize>(block->content.size()));
                   arriving->got += block->content.size();
                   if (arriving->got < block->size_bytes) return false;
                   arriving->file.close();
                   std::filesystem::rename(arriving->path, kept, failed);
                   if (arriving->file.fail() || failed)
                     return give_up({ErrorCode::StorageFailed, "the file could not be kept at the scan site"});
                   done(kept);
                   return true;
                 });
}

}  // namespace telefab::scan
