// SPDX-License-Identifier: GPL-3.0-or-later
#include "fab_site.hpp"

#include <fmt/format.h>

#include <algorithm>

#include <telefab/base/file.hpp>
#include <telefab/base/version.hpp>
#include <telefab/command_line/machine_choice.hpp>
#include <telefab/fab/planning/preflight.hpp>
#include <telefab/service/saved_message.hpp>

#include "accuracy.hpp"
#include "plan_print.hpp"
#include "upload.hpp"

namespace telefab::fab {
namespace {

constexpr const char* kThreeJs = "/usr/share/javascript/three/three.min.js";  // Debian libjs-three
constexpr std::uint64_t kMaxThreeJsBytes = 4U << 20U;
constexpr auto kDarkLookEvery = std::chrono::milliseconds{20};

/// What an operator can put right at the machine; nothing of the job is lost by it.
bool is_device_trouble(ErrorCode code) {
  return code == ErrorCode::DeviceLost || code == ErrorCode::DeviceTimeout || code == ErrorCode::DeviceRefused;
}

/// What an operator can put right at the site; likewise.
bool is_site_trouble(ErrorCode code) {
  return code == ErrorCode::StorageFailed || code == ErrorCode::NotTrusted || code == ErrorCode::Conflict;
}

constexpr auto kRetryEvery = std::chrono::seconds{10};
constexpr const char* kAutomatic = "automatic";  ///< whose word a job prints by where no operator is asked

}  // namespace

Result<void> serve_fab_site(const FabSiteConfig& config, const Clock& clock, std::stop_token stop) {
  auto site = FabSite::open(config, clock);
  if (!site) return tl::unexpected{site.error()};
  return (*site)->run(std::move(stop));
}

Result<std::unique_ptr<FabSite>> FabSite::open(const FabSiteConfig& config, const Clock& clock) {
  auto machines = machine_profiles(config.serve.machines);
  if (!machines) return tl::unexpected{machines.error()};
  auto folder = DataFolder::open(config.serve.data);
  if (!folder) return tl::unexpected{folder.error()};
  std::unique_ptr<FabSite> site{new FabSite{std::move(*folder), clock, std::move(machines->machines), config}};
  if (auto started = site->start(); !started) return tl::unexpected{started.error()};
  return site;
}

Result<void> FabSite::start() {
  auto tracker = JobTracker::open(folder_.path(), config_.serve.hooks, clock_);
  if (!tracker) return tl::unexpected{tracker.error()};
  tracker_ = std::move(*tracker);
  counters_ = std::make_unique<LiveCounters>(loop_, *tracker_);
  auto trust = trust_of(config_.serve);
  if (!trust) return tl::unexpected{trust.error()};

  predictor_ = std::make_unique<WorkQueue>(
      "predictor", [this](const std::string& job, std::stop_token token) { predict(job, std::move(token)); });
  planner_ =
      std::make_unique<WorkQueue>("planner", [this](const std::string& job, std::stop_token stop) { plan(job, stop); });
  device_ =
      std::make_unique<WorkQueue>("device", [this](const std::string& job, std::stop_token stop) { print(job, stop); });
  const auto left = store().unfinished();
  if (!left) return tl::unexpected{left.error()};
  for (const Job& job : *left)
    if (auto taken = resume_unfinished(job); !taken) {
      // Nothing lights of what cannot be read, and nothing of it is given up.
      if (!is_before(job.state, JobState::AwaitingApproval))
        move(job.id, JobState::Paused, taken.error().what + "; telefab resume tries again");
      else
        log_warning(taken.error().what, {job.id});
    }

  auto listener = open_listener(
      loop_, config_.serve, *trust, [this](const net::ConnectionPtr& connection) { on_connection(connection); },
      [this](std::string_view who, std::string_view what) { note(who, what); });
  if (!listener) return tl::unexpected{listener.error()};
  listener_ = std::move(*listener);
  return start_web();
}

Result<void> FabSite::start_web() {
  if (config_.serve.web.empty()) return {};
  auto token = web_token(folder_);
  if (!token) return tl::unexpected{token.error()};
  page_backend_ = std::make_unique<SitePageBackend>(
      store(), folder_, machines_,
      [this](const Command& asked, std::function<void(Result<Job>)> done) {
        later([this, asked, done = std::move(done)] {
          note(asked.who, fmt::format("{} {}", name_of(asked.command), asked.job));
          command(asked, done);
        });
      },
      [this](const NewJob& upload, std::function<void(Result<Job>)> done) {
        later([this, upload, done = std::move(done)] { done(take_upload(upload)); });
      },
      [this](const std::string& job) {
        return JobQuestions{is_exposure_unknown(job), waits_for_platform(job)};
      });
  std::string three_js;
  if (const auto library = read_file(kThreeJs, kMaxThreeJsBytes))
    three_js.assign(reinterpret_cast<const char*>(library->data()), library->size());
  web_site_ = std::make_unique<FabWeb>(*page_backend_,
                                       WebOptions{std::move(*token), std::string{kVersion}, std::move(three_js)});
  auto server = open_page(config_.serve, folder_, *web_site_, fmt::format("telefab-fab/{}", kVersion));
  if (!server) return tl::unexpected{server.error()};
  web_ = std::move(*server);
  return {};
}

FabSite::~FabSite() {
  web_.reset();
  listener_.reset();
  if (predictor_) predictor_->end();
  if (planner_) planner_->end();
  if (device_) device_->end();
}

Result<void> FabSite::run(std::stop_token stop) {
  set_thread_name("network");
  if (auto announced = folder_.announce_port(listener_->port()); !announced) return announced;
  log_line(fmt::format("telefab-fab listens on port {}", listener_->port()));
  ServiceNotifier service;
  service.begin(loop_, [this] { return is_printer_alive(); });
  // The loop goes on, and feeds the watchdog, until the print under way is dark and its journal says so.
  const std::function<void()> end_when_dark = [&] {
    if (device_->has_ended()) return loop_.stop();
    loop_.after(kDarkLookEvery, end_when_dark);
  };
  const std::stop_callback on_stop{stop, [&] {
                                     later([&] {
                                       if (!device_->is_idle())
                                         log_line("telefab-fab ends when the light of the print under way has ended");
                                       predictor_->ask_to_end();
                                       planner_->ask_to_end();
                                       device_->ask_to_end();
                                       end_when_dark();
                                     });
                                   }};
  loop_.run();
  service.end();
  log_line("telefab-fab ends; a print under way is dark and is resumed at the next start");
  return {};
}

void FabSite::on_connection(const net::ConnectionPtr& connection) {
  Hello own{kProtocolVersion, Side::FabSite, fmt::format("telefab-fab {}", kVersion), machines().machine_toml,
            config_.start_on_approval ? "on-approval" : "automatic"};
  const std::weak_ptr<net::Connection> weak = connection;
  handshake(
      loop_, connection, std::move(own),
      [this, weak](const Hello& theirs) {
        const auto strong = weak.lock();
        if (!strong) return;
        if (theirs.side == Side::ScanSite)
          serve_scan_site(loop_, strong, *this, *this);
        else
          serve_client(loop_, strong, *this, {});
      },
      [this, address = connection->peer().address](const Error& why) { note(address, "refused: " + why.what); });
}

void FabSite::note(std::string_view who, std::string_view what) { tracker_->note(who, what); }

Machines FabSite::machines() {
  Machines machines;
  for (const MachineProfile& machine : machines_) machines.machine_toml.push_back(to_toml(machine));
  machines.origin = "this fab";
  return machines;
}

Result<void> FabSite::may_submit(const Submit&) {
  return fail(ErrorCode::NotPermitted, "a fab takes layers, no scans: submit to a scan site");
}

Result<Job> FabSite::submit(const Submit& submit, const std::filesystem::path&, std::string_view) {
  return tl::unexpected{may_submit(submit).error()};
}

// ---- jobs in ---------------------------------------------------------------------------------------------------

Result<std::shared_ptr<Intake>> FabSite::take_offer(const Offer& offer, const net::Peer& peer) {
  const std::string& site = peer.name;
  const auto signer = site_keys_.check(offer, peer);
  if (!signer) return tl::unexpected{signer.error()};
  const auto machine = find_machine(machines_, offer.machine);
  if (!machine) return tl::unexpected{machine.error()};
  auto job = store().find(offer.job);
  if (job && job->owner != site)
    return fail(ErrorCode::Conflict, fmt::format("replayed-job: there is a job {} of another site", offer.job));
  const auto folder = folder_.job(offer.job);
  if (!folder) return tl::unexpected{folder.error()};
  if (job && is_before(JobState::Sending, job->state)) {
    const auto before = saved_offer(*folder);
    if (!before || to_frame(*before) != to_frame(offer))
      return fail(ErrorCode::Conflict, fmt::format("replayed-job: job {} was another one", offer.job));
    return std::shared_ptr<Intake>{};
  }
  if (offer.profile != digest_of_profile(*machine) || offer.header.machine != machine->name)
    return fail(ErrorCode::Conflict,
                fmt::format("the profile of {} was changed since the scan was cut; submit it again", machine->name));
  if (!job) {
    job = store().create({offer.job, offer.name, offer.machine, offer.parameters, site});
    if (!job) return tl::unexpected{job.error()};
    note(site, fmt::format("offer {} {} for {} by {}, {}", offer.job, offer.name, offer.machine, offer.owner, *signer));
  }
  Live& live = live_[offer.job];
  if (!live.intake) {
    auto analysis = std::make_shared<LayerStream>(*machine);
    auto intake = Intake::open(*folder, offer, [analysis](const Layer& layer) { analysis->add(layer); });
    if (!intake) return tl::unexpected{intake.error()};
    live.analysis = std::move(analysis);
    live.intake = std::make_shared<Intake>(std::move(*intake));
    live.send_began = clock_.now();
    counters_->begin(offer.job, job->counters);
  } else if (to_frame(live.intake->offer()) != to_frame(offer)) {
    return fail(ErrorCode::Conflict, fmt::format("replayed-job: job {} is another one", offer.job));
  }
  counters_->change(offer.job, [&](JobCounters& c) {
    c.layers = offer.header.layer_count;
    c.layers_sent = live.intake->spool().layer_count();
  });
  move(offer.job, JobState::Sending, "");
  auto intake = live.intake;
  if (intake->is_complete()) completed(offer.job);
  return intake;
}

void FabSite::received(const std::string& job, std::uint32_t layers, std::uint64_t bytes) {
  counters_->change(job, [&](JobCounters& c) {
    c.layers_sent = layers;
    c.wire_bytes += bytes;
  });
}

void FabSite::completed(const std::string& job) {
  const auto live = live_.find(job);
  const auto now = store().find(job);
  if (live == live_.end() || !now || is_before(JobState::Sending, now->state)) return;
  live->second.intake.reset();
  if (live->second.analysis) {
    const std::scoped_lock lock{analysed_mutex_};
    analysed_[job] = std::move(live->second.analysis);
  }
  const double seconds = std::chrono::duration<double>(clock_.now() - live->second.send_began).count();
  tracker_->set_stage_seconds(job, JobStage::Send, seconds);
  move(job, JobState::Planning, "");
  planner_->add(job);
}

Result<Job> FabSite::take_upload(const NewJob& upload) {
  const auto folder = folder_.job(*upload.id);
  if (!folder) return tl::unexpected{folder.error()};
  const auto offer = saved_offer(*folder);
  if (!offer) return tl::unexpected{offer.error()};
  auto job = store().create(upload);
  if (!job) return job;
  note(upload.owner, fmt::format("upload {} {} for {} {}", job->id, job->name, job->machine, upload.parameters));
  Live& live = live_[job->id];
  live.send_began = clock_.now();
  counters_->begin(job->id, job->counters);
  counters_->change(job->id, [&](JobCounters& c) {
    c.layers = c.layers_sent = offer->header.layer_count;
    if (const auto spool = ChunkSpool::open(*folder / "chunks")) c.wire_bytes = spool->payload_bytes();
  });
  completed(job->id);
  return store().find(job->id);
}

void FabSite::broken(const std::string& job, const Error& why) { end_job(job, JobState::Failed, why.what); }

Result<void> FabSite::resume_unfinished(const Job& job) {
  live_[job.id] = {};
  counters_->begin(job.id, job.counters);
  if (!is_before(job.state, JobState::AwaitingApproval)) return rule_at_start(job);
  const auto folder = folder_.job(job.id);
  if (!folder) return tl::unexpected{folder.error()};
  const auto before = start_case(*folder, job);
  if (!before) return tl::unexpected{before.error()};
  if (before->facts.order.order == Order::Cancel) {
    end_job(job.id, JobState::Cancelled, fmt::format("by {}", before->facts.order.by));
    return {};
  }
  // The word by which it would print by itself once planned is as old as its last change.
  StartFacts facts;
  facts.order = {Order::GoOn, kAutomatic, {}};
  facts.last_sign = std::chrono::milliseconds{job.changed_unix_ms};
  if (may_light_at_start(facts, false, config_.at_start, clock_.wall()).ruling != StartRuling::GoOn)
    if (auto held = hold_for_approval(*folder); !held) return held;
  if (job.state == JobState::Planning) {
    planner_->add(job.id);
    return {};
  }
  // A scan site will offer its job again; nobody would an upload, whose layers are all here.
  if (const auto intake = Intake::reopen(*folder); intake && intake->is_complete()) completed(job.id);
  return {};
}

Result<void> FabSite::rule_at_start(const Job& job) {
  if (job.state == JobState::AwaitingApproval || job.state == JobState::Ready) predictor_->add(job.id);
  const auto folder = folder_.job(job.id);
  if (!folder) return tl::unexpected{folder.error()};
  const auto before = start_case(*folder, job);
  if (!before) return tl::unexpected{before.error()};
  const StartVerdict verdict = may_light_at_start(before->facts, before->has_begun, config_.at_start, clock_.wall());
  const std::string why = sentence_of(verdict);
  switch (verdict.ruling) {
    case StartRuling::GoOn:
    case StartRuling::KeepRecord:
      device_->add(job.id);  // its journal knows how far it came
      break;
    case StartRuling::End:
      end_job(job.id, JobState::Cancelled, fmt::format("by {}", before->facts.order.by));
      break;
    case StartRuling::WaitForApproval:
      if (job.state != JobState::AwaitingApproval)
        move(job.id, JobState::AwaitingApproval, fmt::format("waits for `telefab approve`: {}", why));
      break;
    case StartRuling::WaitForResume:
      if (!before->point.maybe_exposed) {
        move(job.id, JobState::Paused, fmt::format("waits for `telefab resume`: {}", why));
        break;
      }
      [[fallthrough]];
    case StartRuling::WaitForDecision:
      set_exposure_unknown(job.id, true);
      move(job.id, JobState::Paused, fmt::format("{}; {}", why, question_about(before->point, job.id)));
      break;
  }
  if (before->has_begun && verdict.ruling != StartRuling::GoOn) darken(job);
  return {};
}

void FabSite::darken(const Job& job) {
  const auto machine = find_machine(machines_, job.machine);
  if (!machine) return;  // its light is no longer this site's
  if (const auto dark = go_dark(*machine); !dark)
    log_warning(
        fmt::format("{}: the light of its print could not be switched off: {}", machine->name, dark.error().what),
        {job.id});
}

// ---- planning and printing -------------------------------------------------------------------------------------

void FabSite::plan(const std::string& job, std::stop_token stop) {
  const Nanoseconds began = clock_.now();
  const auto attempt = [&]() -> Result<PlanOutcome> {
    const auto found = store().find(job);
    if (!found) return tl::unexpected{found.error()};
    const auto machine = find_machine(machines_, found->machine);
    if (!machine) return tl::unexpected{machine.error()};
    const auto folder = folder_.job(job);
    if (!folder) return tl::unexpected{folder.error()};
    const auto stack = received_stack(*folder);
    if (!stack) return tl::unexpected{stack.error()};
    const std::uint32_t layers = stack->header().layer_count;
    PlanOptions options = config_.planning;
    options.job = job;
    options.regions = take_analysed(job, layers);
    return plan_into(
        *folder, *stack, *machine, std::move(options), clock_,
        [&](const Progress& progress) {
          if (progress.stage != WorkStage::MakingMasks) return;
          // How many layers the supports add is known at the end only.
          later([this, job, layers, done = static_cast<std::uint32_t>(progress.fraction * layers)] {
            count_planned(job, done, layers);
          });
        },
        stop);
  };
  Result<PlanOutcome> outcome = fail(ErrorCode::Internal, "not begun");
  try {
    outcome = attempt();
  } catch (const std::exception& error) {
    outcome = fail(ErrorCode::Internal, fmt::format("planning: a fault of Telefab: {}", error.what()));
  }
  if (stop.stop_requested()) return;  // planned again at the next start, or cancelled
  later([this, job, outcome, seconds = std::chrono::duration<double>(clock_.now() - began).count()] {
    if (!outcome) return end_job(job, JobState::Failed, outcome.error().what);
    count_planned(job, outcome->print_layers, outcome->print_layers);
    tracker_->set_stage_seconds(job, JobStage::Plan, seconds);
    planned(job, outcome->hold_reason);
    predictor_->add(job);
  });
}

std::shared_ptr<const PartRegions> FabSite::take_analysed(const std::string& job, std::uint32_t layers) {
  std::shared_ptr<LayerStream> analysis;
  {
    const std::scoped_lock lock{analysed_mutex_};
    const auto found = analysed_.find(job);
    if (found == analysed_.end()) return nullptr;
    analysis = std::move(found->second);
    analysed_.erase(found);
  }
  auto part = analysis->finish();
  // What went wrong is said by the planner, which begins again.
  if (!part || part->layers.size() != layers) return nullptr;
  return std::make_shared<const PartRegions>(std::move(*part));
}

void FabSite::count_planned(const std::string& job, std::uint32_t done, std::uint32_t all) {
  counters_->change(job, [&](JobCounters& c) {
    c.print_layers = all;
    c.layers_planned = done;
  });
}

void FabSite::planned(const std::string& job, const std::string& hold_reason) {
  const auto folder = folder_.job(job);
  if (config_.start_on_approval || !hold_reason.empty() || (folder && waits_for_approval(*folder)))
    return move(job, JobState::AwaitingApproval,
                fmt::format("waits for `telefab approve`{}{}", hold_reason.empty() ? "" : ": ", hold_reason));
  const auto now = store().find(job);
  if (!now || is_final(now->state)) return;
  move(job, JobState::Ready, "");
  if (auto put = put_on_machine(*now, {JournalStep::Approved, kAutomatic, {}, {}}); !put)
    move(job, JobState::AwaitingApproval, fmt::format("waits for `telefab approve`: {}", put.error().what));
}

void FabSite::on_print_progress(const std::string& job, const PrintProgress& progress) {
  later([this, job, progress] {
    const auto now = store().find(job);
    if (!now) return;
    const std::uint32_t printed = progress.layer.count();
    const bool is_live = counters_->change(job, [&](JobCounters& c) {
      if (c.layers_printed != printed)
        log_detail(fmt::format("job {} printed {} of {} layers", job, printed, progress.layers.count()),
                   {job, static_cast<std::int64_t>(printed) - 1});
      c.print_layers = progress.layers.count();
      c.layers_printed = printed;
    });
    if (!is_live) return;
    // A fault says in its record whether a layer was perhaps exposed.
    if (progress.state != "faulted") set_exposure_unknown(job, progress.state == "awaiting-decision");
    if (progress.state == "done" || progress.state == "cancelled") return;  // the record follows
    // Stopped with the site, not by a fault of its own: the journal says which, and the next start goes by it.
    if (progress.state == "faulted" && device_->is_ending()) return;
    const bool waits =
        progress.state == "paused" || progress.state == "awaiting-decision" || progress.state == "faulted";
    if (waits)
      move(job, JobState::Paused, progress.message);
    else if (now->state != JobState::Printing || now->message != progress.message)
      move(job, JobState::Printing, "");
  });
}

bool FabSite::is_printer_alive() {
  // Before its first wait the print opens devices and codes every mask, for as long as that takes.
  const std::uint64_t beats = print_beats_;
  return print_beat_.is_alive(beats > 0 ? std::optional{beats} : std::nullopt, clock_.now());
}

void FabSite::predict(const std::string& job, std::stop_token stop) {
  const auto attempt = [&]() -> Result<void> {
    const auto found = store().find(job);
    if (!found) return tl::unexpected{found.error()};
    const auto folder = folder_.job(job);
    if (!folder) return tl::unexpected{folder.error()};
    std::error_code error;
    if (std::filesystem::exists(*folder / "report" / "accuracy.png", error)) return {};
    return keep_accuracy(*folder, found->machine, config_.serve.machines, stop);
  };
  Result<void> outcome = fail(ErrorCode::Internal, "not begun");
  try {
    outcome = attempt();
  } catch (const std::exception& error) {
    outcome = fail(ErrorCode::Internal, fmt::format("a fault of Telefab: {}", error.what()));
  }
  // The print needs none of it; whoever looks for the picture finds the reason in the log.
  if (!outcome && !stop.stop_requested())
    later([job, why = outcome.error().what] {
      log_line(fmt::format("job {}: no accuracy picture: {}", job, why), {job});
    });
}

void FabSite::print(const std::string& job, std::stop_token stop) {
  const auto next = store().find(job);
  if (!next || is_final(next->state)) return;
  if (const auto known = find_machine(machines_, next->machine); known && !take_platform(*next, *known)) return;
  // Not before the store says so: what the next start knows of this print begins there.
  tracker_->move(job, JobState::Printing, "");
  if (const auto now = store().find(job); !now || now->state != JobState::Printing) {
    if (!now || !is_final(now->state))
      later([this, job] { loop_.after(kRetryEvery, [this, job] { device_->add(job); }); });
    return;
  }
  const auto control = std::make_shared<PrintControl>();
  {
    const std::lock_guard lock{control_mutex_};
    printing_ = job;
    control_ = control;
  }
  const Nanoseconds began = clock_.now();
  const auto attempt = [&]() -> Result<PrintRecord> {
    const auto found = store().find(job);
    if (!found) return tl::unexpected{found.error()};
    const auto machine = find_machine(machines_, found->machine);
    if (!machine) return tl::unexpected{machine.error()};
    const auto folder = folder_.job(job);
    if (!folder) return tl::unexpected{folder.error()};
    PrintPolicy policy;
    policy.maybe_exposed = config_.at_start.maybe_exposed;
    return print_from(
        *folder, *machine, policy, *control, [&](const PrintProgress& progress) { on_print_progress(job, progress); },
        print_beats_, stop);
  };
  Result<PrintRecord> record = fail(ErrorCode::Internal, "not begun");
  try {
    record = attempt();
  } catch (const std::exception& error) {
    record = fail(ErrorCode::Internal, fmt::format("printing: a fault of Telefab: {}", error.what()));
  }
  {
    const std::lock_guard lock{control_mutex_};
    printing_.clear();
    control_.reset();
    print_beats_ = 0;
  }
  control->close();                  // words that came too late are kept without it
  if (device_->is_ending()) return;  // the journal tells the next start where to go on
  later([this, job, record, seconds = std::chrono::duration<double>(clock_.now() - began).count()] {
    tracker_->set_stage_seconds(job, JobStage::Print, seconds);
    if (!record && (is_device_trouble(record.error().code) || is_site_trouble(record.error().code)))
      return move(job, JobState::Paused, record.error().what + "; telefab resume tries again");
    if (!record) return end_job(job, JobState::Failed, record.error().what);
    // Nothing was made: the platform is as empty as before.
    if (const auto ended = store().find(job);
        ended && record->layers.empty() && record->outcome != PrintOutcome::Faulted)
      if (auto cleared = platforms_.clear(ended->machine); !cleared) log_warning(cleared.error().what, {job});
    counters_->change(job, [&](JobCounters& c) { c.layers_printed = record->next.count(); });
    switch (record->outcome) {
      case PrintOutcome::Done:
        return end_job(job, JobState::Done, "");
      case PrintOutcome::Cancelled:
        return end_job(job, JobState::Cancelled, fmt::format("at layer {}", record->next.count()));
      case PrintOutcome::Faulted:
        set_exposure_unknown(job, record->maybe_exposed);
        return move(job, JobState::Paused,
                    fmt::format("faulted at layer {}: {}; {}", record->next.count(), record->cause.what,
                                record->maybe_exposed
                                    ? "the layer was perhaps exposed: telefab resume --as treat-as-exposed|expose-again"
                                    : "telefab resume tries again"));
    }
  });
}

// ---- commands and files ----------------------------------------------------------------------------------------

void FabSite::command(const Command& command, std::function<void(Result<Job>)> done) {
  const std::string& id = command.job;
  if (command.command == JobCommand::Cleared) return done(clear_platform(id));
  const auto job = store().find(id);
  if (!job) return done(job);
  const auto refuse = [&](std::string_view why) {
    done(fail(ErrorCode::Conflict, fmt::format("job {} is {}: {}", id, name_of(job->state), why)));
  };
  if (is_final(job->state)) return refuse("it has ended");
  std::shared_ptr<PrintControl> control;
  {
    const std::lock_guard lock{control_mutex_};
    if (printing_ == id) control = control_;
  }
  const auto answer = [&](const Result<void>& outcome) {
    if (outcome)
      done(store().find(id));
    else
      done(tl::unexpected{outcome.error()});
  };
  std::optional<Decision> decision;
  switch (command.command) {
    case JobCommand::Approve:
      if (job->state != JobState::AwaitingApproval) return refuse("there is nothing to approve");
      return answer(approve(*job, command));
    case JobCommand::Pause:
      if (job->state != JobState::Printing) return refuse("only a print can be paused");
      if (control) return pass_to_print(command, control, done);
      return answer(pause(*job, command.who));
    case JobCommand::TreatAsExposed:
    case JobCommand::ExposeAgain:
      if (control && !is_exposure_unknown(id))
        return refuse("no layer of it was perhaps exposed; resume it without saying what the layer was");
      decision = command.command == JobCommand::ExposeAgain ? Decision::ExposeAgain : Decision::TreatAsExposed;
      [[fallthrough]];
    case JobCommand::Resume:
      if (job->state != JobState::Paused) return refuse("it is not paused");
      if (control) return pass_to_print(command, control, done);
      return answer(put_on_machine(*job, {JournalStep::Resumed, command.who, {}, decision}));
    case JobCommand::Cancel:
      if (control) return pass_to_print(command, control, done);
      return answer(cancel(*job, command.who));
    case JobCommand::Cleared:
      break;  // about a machine, not a job
  }
}

// ---- the platform ----------------------------------------------------------------------------------------------

bool FabSite::take_platform(const Job& job, const MachineProfile& machine) {
  const auto there = platforms_.part_on(machine.name);
  const bool is_own = there && *there == job.id;
  const bool is_free = there && !*there;
  if (is_own) return true;
  if (needs_clearing(config_.platform, machine) && !is_free) {
    const std::string occupant = there ? **there : there.error().what;
    later([this, job, occupant] { wait_for_platform(job, occupant); });
    return false;
  }
  if (auto taken = platforms_.occupy(machine.name, job.id); !taken) {
    log_warning(taken.error().what, {job.id});
    later([this, id = job.id] { loop_.after(kRetryEvery, [this, id] { device_->add(id); }); });
    return false;
  }
  return true;
}

void FabSite::wait_for_platform(const Job& job, const std::string& occupant) {
  const auto now = store().find(job.id);
  if (!now || is_final(now->state)) return;
  {
    const std::lock_guard lock{control_mutex_};
    for_platform_.insert(job.id);
  }
  move(job.id, now->state,
       fmt::format("waits for an empty platform: the part of {} is on that of {}; take it off, then telefab cleared {}",
                   occupant, job.machine, job.machine));
}

Result<Job> FabSite::clear_platform(const std::string& machine) {
  if (const auto known = find_machine(machines_, machine); !known) return tl::unexpected{known.error()};
  const auto there = platforms_.part_on(machine);
  if (!there) return tl::unexpected{there.error()};
  if (!*there) return fail(ErrorCode::Conflict, fmt::format("the platform of {} is empty already", machine));
  auto occupant = store().find(**there);
  if (occupant && !is_final(occupant->state))
    return fail(ErrorCode::Conflict, fmt::format("job {} is {} on the platform of {}; cancel it first", occupant->id,
                                                 name_of(occupant->state), machine));
  if (auto cleared = platforms_.clear(machine); !cleared) return tl::unexpected{cleared.error()};
  std::set<std::string> waiting;
  {
    const std::lock_guard lock{control_mutex_};
    waiting.swap(for_platform_);
  }
  for (const std::string& id : waiting) device_->add(id);  // those of other machines wait again
  if (occupant) return occupant;
  Job forgotten;  // the job list no longer knows it; the platform is empty all the same
  forgotten.id = **there;
  forgotten.machine = machine;
  return forgotten;
}

bool FabSite::waits_for_platform(const std::string& job) {
  const std::lock_guard lock{control_mutex_};
  return for_platform_.contains(job);
}

void FabSite::pass_to_print(const Command& command, const std::shared_ptr<PrintControl>& control,
                            std::function<void(Result<Job>)> done) {
  // Answered on the network thread once the journal has the word; a print that ended meanwhile hands it back.
  const WordKept kept = [this, command, done = std::move(done)](const std::optional<Result<void>>& outcome) {
    later([this, command, done, outcome] {
      if (!outcome) return this->command(command, done);
      if (!*outcome) return done(tl::unexpected{outcome->error()});
      done(store().find(command.job));
    });
  };
  switch (command.command) {
    case JobCommand::Pause:
      return control->pause(command.who, kept);
    case JobCommand::Cancel:
      return control->cancel(command.who, kept);
    case JobCommand::TreatAsExposed:
      return control->decide(Decision::TreatAsExposed, command.who, kept);
    case JobCommand::ExposeAgain:
      return control->decide(Decision::ExposeAgain, command.who, kept);
    default:
      return control->resume(command.who, kept);
  }
}

Result<void> FabSite::keep(const Job& job, const PrintWord& word) {
  const auto folder = folder_.job(job.id);
  if (!folder) return tl::unexpected{folder.error()};
  const std::lock_guard lock{control_mutex_};
  if (printing_ == job.id)
    return fail(ErrorCode::Conflict, fmt::format("job {} went on its machine just now; say it again", job.id));
  return keep_word(*folder, job, word, clock_.wall());
}

Result<void> FabSite::put_on_machine(const Job& job, const PrintWord& word) {
  if (auto kept = keep(job, word); !kept) return kept;
  set_exposure_unknown(job.id, false);
  if (job.state == JobState::AwaitingApproval || job.state == JobState::Ready) move(job.id, JobState::Ready, "");
  device_->add(job.id);
  return {};
}

Result<void> FabSite::approve(const Job& job, const Command& command) {
  const auto folder = folder_.job(job.id);
  if (!folder) return tl::unexpected{folder.error()};
  const auto preflight = preflight_in(*folder / "plan");
  if (!preflight) return tl::unexpected{preflight.error()};
  const auto why = let_through(*preflight, command.although);
  if (!why) return fail_in(fmt::format("job {}", job.id), why.error());
  return put_on_machine(job, {JournalStep::Approved, command.who, *why, {}});
}

Result<void> FabSite::pause(const Job& job, const std::string& who) {
  if (auto kept = keep(job, {JournalStep::PauseAsked, who, {}, {}}); !kept) return kept;
  device_->drop(job.id);
  move(job.id, JobState::Paused, "");
  return {};
}

Result<void> FabSite::cancel(const Job& job, const std::string& who) {
  if (auto kept = keep(job, {JournalStep::CancelAsked, who, {}, {}}); !kept) return kept;
  planner_->drop(job.id);
  predictor_->drop(job.id);
  device_->drop(job.id);
  {
    const std::lock_guard lock{control_mutex_};
    for_platform_.erase(job.id);
  }
  end_job(job.id, JobState::Cancelled, fmt::format("by {}", who));
  return {};
}

bool FabSite::is_exposure_unknown(const std::string& job) {
  const std::lock_guard lock{control_mutex_};
  return exposure_unknown_.contains(job);
}

void FabSite::set_exposure_unknown(const std::string& job, bool is_unknown) {
  const std::lock_guard lock{control_mutex_};
  if (is_unknown)
    exposure_unknown_.insert(job);
  else
    exposure_unknown_.erase(job);
}

void FabSite::files(const std::string& job, std::function<void(Result<std::vector<FileEntry>>)> done) {
  if (const auto found = store().find(job); !found) return done(tl::unexpected{found.error()});
  const auto folder = folder_.job(job);
  if (!folder) return done(tl::unexpected{folder.error()});
  auto files = files_of(*folder / "plan");
  for (FileEntry& file : files_of(*folder / "report")) files.push_back(std::move(file));
  done(std::move(files));
}

void FabSite::file(const std::string& job, const std::string& name,
                   std::function<void(Result<std::filesystem::path>)> done) {
  if (const auto found = store().find(job); !found) return done(tl::unexpected{found.error()});
  const auto folder = folder_.job(job);
  if (!folder) return done(tl::unexpected{folder.error()});
  std::error_code error;
  for (const char* part : {"plan", "report"})
    if (const auto path = *folder / part / name; std::filesystem::is_regular_file(path, error)) return done(path);
  done(fail(ErrorCode::NotFound, fmt::format("job {} has no file {}", job, name)));
}

void FabSite::move(const std::string& job, JobState state, std::string_view message) {
  counters_->keep();
  tracker_->move(job, state, message);
}

void FabSite::end_job(const std::string& job, JobState state, std::string_view message) {
  move(job, state, message);
  set_exposure_unknown(job, false);
  counters_->end(job);
  live_.erase(job);
  const std::scoped_lock lock{analysed_mutex_};
  analysed_.erase(job);
}

}  // namespace telefab::fab
