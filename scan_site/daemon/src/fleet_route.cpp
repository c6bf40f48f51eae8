// SPDX-License-Identifier: GPL-3.0-or-later
#include "fleet_route.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <nlohmann/json.hpp>
#include <telefab/base/json_text.hpp>
#include <telefab/fleet/fleet_words.hpp>
#include <telefab/service/log.hpp>
#include <telefab/service/profile_choice.hpp>
#include <telefab/wire/job_signature.hpp>
#include <telefab/wire/stack_key.hpp>

namespace telefab::scan {
namespace {

constexpr Nanoseconds kTick = std::chrono::seconds{1};
/// Fabs and machines are asked for so often where nothing wants them earlier.
constexpr int kTicksToStanding = 10;
/// And so often where something has happened.
constexpr int kTicksWhereBusy = 3;
constexpr std::size_t kMostEvents = 1000;
constexpr std::size_t kMostJobs = 200;

/// Not now, but perhaps later.
bool is_away(const Error& why) { return why.code == ErrorCode::Unreachable || why.code == ErrorCode::StorageFailed; }

Result<ProfileCatalogue> catalogue_of(const fleet::Fab& fab) {
  const auto object = json_or_discarded(fab.catalogue);
  const auto texts = [&](const char* key) {
    std::vector<std::string> all;
    if (const auto found = object.find(key); found != object.end() && found->is_array())
      for (const auto& text : *found)
        if (text.is_string()) all.push_back(text.get<std::string>());
    return all;
  };
  if (!object.is_object()) return fail(ErrorCode::InvalidInput, "its profiles are not a JSON object");
  return ProfileCatalogue::from_texts(texts("machine_toml"), texts("resin_toml"), texts("print_toml"),
                                      "of the fab " + fab.name);
}

/// What all of them offer. Of two files of one name and kind the first is taken: a job that is cut for it is printed
/// where that is the machine's, and not elsewhere.
std::optional<ProfileCatalogue> catalogue_of(const std::vector<ProfileCatalogue>& all) {
  std::vector<ProfilePart> parts;
  for (const ProfileCatalogue& each : all)
    for (const ProfilePart& part : each.parts())
      if (std::ranges::none_of(
              parts, [&](const ProfilePart& known) { return known.kind == part.kind && known.name == part.name; }))
        parts.push_back(part);
  auto merged = ProfileCatalogue::from(std::move(parts));
  if (merged) return std::move(*merged);
  log_warning(fmt::format("the profiles of the fabs of the fleet do not go together: {}", merged.error().what));
  return all.empty() ? std::nullopt : std::optional{all.front()};
}

MachineStatus status_of(const fleet::Machine& machine, std::int64_t now_unix_ms) {
  MachineStatus status;
  status.name = machine.name;
  status.profile = machine.profile;
  status.resin = machine.resin;
  status.is_stated = true;
  switch (machine.readiness) {
    case fleet::Readiness::Free:
      break;
    case fleet::Readiness::Busy:
      status.state = MachineState::Printing;
      break;
    case fleet::Readiness::Occupied:
      status.state = MachineState::Occupied;
      break;
    case fleet::Readiness::Trouble:
      status.state = MachineState::Fault;
      break;
  }
  if (machine.is_draining) status.message = "taken out of service: it gets no new job";
  if (!fleet::is_seen(machine, now_unix_ms)) {
    status.state = MachineState::Offline;
    status.message = fmt::format("its fab {} is not heard of", machine.fab);
  }
  return status;
}

}  // namespace

std::string FleetRoute::json_of(Standing& standing) {
  std::ranges::sort(standing.jobs, fleet::is_before);
  std::string machines, jobs;
  for (const fleet::Machine& machine : standing.machines) {
    std::string object = to_json(machine);
    object.pop_back();
    const bool is_seen = fleet::is_seen(machine, standing.now_unix_ms);
    machines += fmt::format("{}{},\"seen\":{}}}", machines.empty() ? "" : ",", object, is_seen);
  }
  for (const fleet::Job& job : standing.jobs) jobs += (jobs.empty() ? "" : ",") + to_json(job);
  const auto waiting = std::ranges::count(standing.jobs, fleet::State::Waiting, &fleet::Job::state);
  return fmt::format(R"({{"machines":[{}],"jobs":[{}],"waiting":{}}})", machines, jobs, waiting);
}

FleetRoute::FleetRoute(net::Loop& loop, Options options, RouteEvents events)
    : loop_{loop}, options_{std::move(options)}, events_{std::move(events)}, link_{loop, options_.open, [this] {
                                                                                     follow();
                                                                                   }} {}

FleetRoute::~FleetRoute() { *alive_ = false; }

void FleetRoute::tick() {
  if (is_standing_wanted_ || --ticks_to_standing_ <= 0) ask_standing();
  follow();
  submit_new();
  if (is_up_ && std::exchange(is_cancel_open_, false)) events_.reached();
  loop_.after(kTick, [this, alive = alive_] {
    if (*alive) tick();
  });
}

void FleetRoute::set_up(bool is_up, const std::string& why) {
  if (is_up == std::exchange(is_up_, is_up) && why == why_down_) return;
  why_down_ = why;
  events_.changed("the queue of the fleet", is_up, why);
}

// ---- fabs and machines ---------------------------------------------------------------------------------------------

void FleetRoute::ask_standing() {
  if (std::exchange(is_asking_standing_, true)) return;
  link_.ask<Standing>(
      [](FleetQueue& queue) -> Result<Standing> {
        auto fabs = queue.fabs();
        if (!fabs) return tl::unexpected{fabs.error()};
        auto machines = queue.machines();
        if (!machines) return tl::unexpected{machines.error()};
        auto jobs = queue.jobs(fleet::kOpenStates, 0, kMostJobs);
        if (!jobs) return tl::unexpected{jobs.error()};
        const auto now = queue.now_unix_ms();
        if (!now) return tl::unexpected{now.error()};
        return Standing{std::move(*fabs), std::move(*machines), std::move(*jobs), *now};
      },
      [this](Result<Standing> standing) {
        is_asking_standing_ = false;
        if (!standing) return set_up(false, standing.error().what);
        is_standing_wanted_ = false;
        ticks_to_standing_ = kTicksToStanding;
        take(std::move(*standing));
      });
}

void FleetRoute::take(Standing standing) {
  events_.standing(json_of(standing));
  machines_.clear();
  for (fleet::Machine& machine : standing.machines) machines_[machine.name] = std::move(machine);
  std::map<std::string, fleet::Fab> fabs;
  for (fleet::Fab& fab : standing.fabs) fabs[fab.name] = std::move(fab);
  if (fabs != std::exchange(fabs_, fabs)) {
    std::vector<ProfileCatalogue> all;
    for (const auto& [name, fab] : fabs_) {
      auto catalogue = catalogue_of(fab);
      if (catalogue)
        all.push_back(std::move(*catalogue));
      else if (odd_catalogues_.insert(name).second)
        log_warning(fmt::format("nothing is cut for the fab {} of the fleet: {}", name, catalogue.error().what));
      if (catalogue) odd_catalogues_.erase(name);
      // A fab at another address is called there from now on.
      const auto line = lines_.find(name);
      if (line == lines_.end() ||
          (line->second.fab.address == fab.address && line->second.fab.certificate == fab.certificate))
        continue;
      for (auto& [job, sending] : jobs_)
        if (sending.place && sending.place->fab == name) sending.place.reset();
      lines_.erase(line);
    }
    profiles_ = all.empty() ? std::nullopt : catalogue_of(all);
  }
  set_up(true, {});
  // A job may be at its end behind that.
  std::vector<std::string> unplaced;
  for (const auto& [job, sending] : jobs_)
    if (sending.known && !sending.place) unplaced.push_back(job);
  for (const std::string& job : unplaced)
    if (const auto found = jobs_.find(job); found != jobs_.end()) bring(job, found->second);
  submit_new();
}

std::string FleetRoute::profile_of(const std::string& machine) const {
  const auto found = machines_.find(machine);
  return found == machines_.end() ? machine : found->second.profile;
}

void FleetRoute::machines(std::function<void(Result<std::vector<MachineStatus>>)> done) {
  link_.ask<std::vector<MachineStatus>>(
      [](FleetQueue& queue) -> Result<std::vector<MachineStatus>> {
        const auto machines = queue.machines();
        if (!machines) return tl::unexpected{machines.error()};
        const auto now = queue.now_unix_ms();
        if (!now) return tl::unexpected{now.error()};
        std::vector<MachineStatus> all;
        for (const fleet::Machine& machine : *machines) all.push_back(status_of(machine, *now));
        return all;
      },
      [done = std::move(done)](Result<std::vector<MachineStatus>> all) {
        done(all ? std::move(all) : fail(all.error().code, "the fleet is not reached: " + all.error().what));
      });
}

FleetRoute::Line* FleetRoute::line_of(const std::string& machine) {
  const auto where = machines_.find(machine);
  const auto fab = where == machines_.end() ? fabs_.end() : fabs_.find(where->second.fab);
  if (fab == fabs_.end()) {
    is_standing_wanted_ = true;  // its fab has announced it since
    return nullptr;
  }
  Line& line = lines_[fab->first];
  if (line.link) return &line;
  const auto endpoint = net::endpoint_from_text(fab->second.address);
  if (!endpoint) {
    log_warning(fmt::format("the fab {} of the fleet: {}", fab->first, endpoint.error().what));
    lines_.erase(fab->first);
    return nullptr;
  }
  net::ConnectOptions options{*endpoint, options_.trust, net::Role::FabSite, {}};
  options.expected_name = fab->second.certificate.empty() ? endpoint->host : fab->second.certificate;
  line.fab = fab->second;
  line.link = std::make_unique<FabLink>(loop_, std::move(options), options_.site_key, line_events(fab->first));
  line.link->start();
  return &line;
}

// ---- jobs ----------------------------------------------------------------------------------------------------------

void FleetRoute::add(const Offer& offer, std::shared_ptr<SharedSpool> spool, const JobWishes& wishes) {
  const auto [slot, is_new] = jobs_.try_emplace(offer.job);
  if (!is_new) return;
  slot->second.offer = offer;
  slot->second.spool = std::move(spool);
  slot->second.wishes = wishes;
  submit_new();
}

fleet::NewJob FleetRoute::new_job(const Sending& sending) const {
  const Offer& offer = sending.offer;
  fleet::NewJob job;
  job.id = offer.job;
  job.name = offer.name;
  job.owner = offer.owner;
  job.site = options_.site;
  job.priority = sending.wishes.priority;
  job.deadline_unix_ms = sending.wishes.deadline_unix_ms;
  if (const auto key = stack_key_of(offer)) job.stack_key = to_hex(*key);
  job.needs.machine = sending.wishes.machine;
  const auto composed = profiles_
                            ? composed_of_job(*profiles_, offer.machine, offer.parameters)
                            : Result<ComposedProfile>{fail(ErrorCode::NotFound, "no profiles of the fleet are known")};
  // What the fleet does not offer any more fits no machine, and says so: `telefab fleet why`.
  job.needs.resin = composed ? composed->resin : std::string{};
  job.needs.light = composed ? light_of(*profiles_, offer.machine, composed->resin) : to_hex(offer.profile);
  job.needs.width_mm = offer.header.bounds.max.x_mm - offer.header.bounds.min.x_mm;
  job.needs.depth_mm = offer.header.bounds.max.y_mm - offer.header.bounds.min.y_mm;
  job.needs.height_mm = offer.header.layer_count * offer.header.layer_thickness_mm;
  return job;
}

void FleetRoute::submit_new() {
  // Followed first: what happens to a job from now on is not missed.
  if (!is_up_ || !followed_) return;
  for (auto& [id, sending] : jobs_) {
    if (sending.known || std::exchange(sending.is_asked, true)) continue;
    link_.ask<fleet::Job>(
        [job = new_job(sending)](FleetQueue& queue) -> Result<fleet::Job> {
          // Submitted in an earlier life it is that one, whatever the machines have become since.
          auto known = queue.find(job.id);
          if (known || known.error().code != ErrorCode::NotFound) return known;
          auto submitted = queue.submit(job);
          if (!submitted) return tl::unexpected{submitted.error()};
          return std::move(submitted->front());
        },
        [this, job = id](const Result<fleet::Job>& known) { on_known(job, known); });
  }
}

void FleetRoute::follow() {
  if (std::exchange(is_following_, true)) return;
  using Events = std::vector<fleet::Event>;
  link_.ask<Events>(
      [after = followed_](FleetQueue& queue) {
        return after ? queue.events(*after, kMostEvents) : queue.newest_events(1);
      },
      [this](const Result<Events>& events) {
        is_following_ = false;
        if (!events) return set_up(false, events.error().what);
        const bool is_first = !followed_;
        if (is_first) followed_ = 0;
        std::set<std::string> changed;
        for (const fleet::Event& event : *events) {
          followed_ = std::max(*followed_, event.number);
          if (!is_first && jobs_.contains(event.job)) changed.insert(event.job);
        }
        if (!events->empty()) ticks_to_standing_ = std::min(ticks_to_standing_, kTicksWhereBusy);
        for (const std::string& job : changed) look_up(job);
        if (is_first) return submit_new();
        if (events->size() == kMostEvents) follow();
      });
}

void FleetRoute::look_up(const std::string& job) {
  const auto found = jobs_.find(job);
  if (found == jobs_.end()) return;
  if (std::exchange(found->second.is_asked, true)) {
    found->second.is_stale = true;
    return;
  }
  link_.ask<fleet::Job>([job](FleetQueue& queue) { return queue.find(job); },
                        [this, job](const Result<fleet::Job>& known) { on_known(job, known); });
}

void FleetRoute::on_known(const std::string& job, const Result<fleet::Job>& known) {
  const auto found = jobs_.find(job);
  if (found == jobs_.end()) return;
  Sending& sending = found->second;
  sending.is_asked = false;
  if (!known) {
    if (is_away(known.error())) {
      set_up(false, known.error().what);
      is_standing_wanted_ = true;  // with it the queue is there again
      sending.known.reset();       // and is asked for the job
      return;
    }
    if (known.error().code == ErrorCode::NotFound) {
      // A queue that was restored is older than its sites: the job is submitted once more.
      take_back(sending);
      sending.known.reset();
      return;
    }
    return events_.jobs.refused(job, {known.error().code, "in the fleet: " + known.error().what});
  }
  sending.known = *known;
  if (std::exchange(sending.is_stale, false)) return look_up(job);
  if (!fleet::is_final(known->state)) return bring(job, sending);
  const JobState end = known->state == fleet::State::Done     ? JobState::Done
                       : known->state == fleet::State::Failed ? JobState::Failed
                                                              : JobState::Cancelled;
  events_.ended(job, end, known->message);
}

void FleetRoute::take_back(Sending& sending) {
  if (!sending.place) return;
  if (const auto line = lines_.find(sending.place->fab); line != lines_.end())
    line->second.link->forget(sending.place->id);
  attempts_.erase(sending.place->id);
  sending.why_refused.clear();
  sending.place.reset();
}

void FleetRoute::bring(const std::string& job, Sending& sending) {
  const fleet::Job& known = *sending.known;
  const std::string id = id_of_attempt(job, std::max(known.attempt, 1U));
  const bool has_machine = known.state != fleet::State::Waiting;
  if (sending.place && has_machine && sending.place->id == id) return events_.jobs.deferred(job, {});
  const auto before = places_.find(job);
  const bool is_elsewhere = before != places_.end() && before->second.id != id;
  take_back(sending);
  if (is_elsewhere) places_.erase(before);
  if (is_elsewhere || !has_machine) events_.taken_back(job, why_waiting(job));
  Line* line = has_machine ? line_of(known.machine) : nullptr;
  if (line != nullptr) {
    Offer offer = sending.offer;
    offer.job = id;
    offer.attempt = known.attempt;
    if (auto signed_now = sign_offer(offer, options_.site_key); !signed_now)
      return events_.jobs.refused(job, signed_now.error());
    sending.place = Place{line->fab.name, id};
    places_[job] = *sending.place;
    attempts_[id] = job;
    line->link->add(offer, sending.spool);
  }
  events_.jobs.deferred(job, {});
}

void FleetRoute::pump(const std::string& job) {
  const auto found = jobs_.find(job);
  if (found == jobs_.end() || !found->second.place) return;
  if (const auto line = lines_.find(found->second.place->fab); line != lines_.end())
    line->second.link->pump(found->second.place->id);
}

void FleetRoute::forget(const std::string& job) {
  const auto found = jobs_.find(job);
  if (found == jobs_.end()) return;
  take_back(found->second);
  jobs_.erase(found);
}

std::string FleetRoute::why_waiting(const std::string& job) const {
  const auto found = jobs_.find(job);
  if (found == jobs_.end()) return {};
  const Sending& sending = found->second;
  if (sending.known && sending.known->state == fleet::State::Asking)
    return fmt::format("{}: {}", sending.known->machine, sending.known->message);
  if (!sending.why_refused.empty()) return sending.why_refused;
  if (sending.place) {
    const auto line = lines_.find(sending.place->fab);
    return line == lines_.end() ? std::string{} : line->second.link->why_waiting(sending.place->id);
  }
  if (!is_up_) return "waits for the queue of the fleet: " + why_down_;
  if (!sending.known || sending.known->state == fleet::State::Waiting) return "waits for a machine of the fleet";
  return fmt::format("waits for the fab of {}", sending.known->machine);
}

void FleetRoute::cancel(const std::string& job, const std::string& who, std::function<void(Result<void>)> done) {
  link_.ask<fleet::Job>(
      [job, who](FleetQueue& queue) -> Result<fleet::Job> {
        auto cancelled = queue.cancel(job, who);
        if (cancelled || cancelled.error().code != ErrorCode::Conflict) return cancelled;
        return queue.find(job);
      },
      [this, job, who, done = std::move(done)](const Result<fleet::Job>& now) {
        const auto outcome = [this, job, done](Result<void> cancelled) {
          if (!cancelled) log_warning("cancelled here, and not in the fleet yet: " + cancelled.error().what, {job});
          if (!cancelled) is_cancel_open_ = true;
          done(std::move(cancelled));
        };
        if (!now && now.error().code != ErrorCode::NotFound) return outcome(tl::unexpected{now.error()});
        if (!now || fleet::is_final(now->state)) return outcome({});
        // It is being printed: its fab ends it.
        Line* line = line_of(now->machine);
        if (line == nullptr)
          return outcome(fail(ErrorCode::Unreachable, fmt::format("the fab of {} is not known now", now->machine)));
        cancel_at({line->link.get(), id_of_attempt(job, now->attempt)}, who, outcome);
      });
}

Result<FabRoute::AtFab> FleetRoute::fab_of(const std::string& job) {
  const auto place = places_.find(job);
  const auto line = place == places_.end() ? lines_.end() : lines_.find(place->second.fab);
  if (line == lines_.end()) return fail(ErrorCode::NotFound, fmt::format("no fab has job {}", job));
  return AtFab{line->second.link.get(), place->second.id};
}

// ---- what fabs tell ------------------------------------------------------------------------------------------------

std::string FleetRoute::job_of(const std::string& fab, const std::string& id) const {
  const auto found = attempts_.find(id);
  const auto sending = found == attempts_.end() ? jobs_.end() : jobs_.find(found->second);
  return sending != jobs_.end() && sending->second.place && sending->second.place->fab == fab ? found->second
                                                                                              : std::string{};
}

FabLinkEvents FleetRoute::line_events(const std::string& fab) {
  FabLinkEvents events;
  events.changed = [this, fab](bool is_up, const std::string& why) {
    log_line(is_up ? fmt::format("the fab {} of the fleet is reached", fab)
                   : fmt::format("the fab {} of the fleet: {}", fab, why));
    for (const auto& [job, sending] : jobs_)
      if (sending.place && sending.place->fab == fab) events_.jobs.deferred(job, {});
    if (is_up) events_.reached();
  };
  events.acknowledged = [this, fab](const std::string& id, std::uint32_t layers, std::uint64_t bytes) {
    if (const auto job = job_of(fab, id); !job.empty()) events_.jobs.acknowledged(job, layers, bytes);
  };
  events.kept = [this, fab](const std::string& id) {
    if (const auto job = job_of(fab, id); !job.empty()) events_.jobs.kept(job);
  };
  events.job_changed = [this, fab](const Job& theirs) { on_job_changed(fab, theirs); };
  events.refused = [this, fab](const std::string& id, const Error& why) { on_refused(fab, id, why); };
  events.unreadable = [this, fab](const std::string& id, const Error& why) {
    if (const auto job = job_of(fab, id); !job.empty()) events_.jobs.unreadable(job, why);
  };
  events.deferred = [this, fab](const std::string& id, const std::string& why) {
    if (const auto job = job_of(fab, id); !job.empty()) events_.jobs.deferred(job, why);
  };
  return events;
}

void FleetRoute::on_job_changed(const std::string& fab, Job theirs) {
  const std::string job = job_of(fab, theirs.id);
  if (job.empty()) return;
  theirs.id = job;
  // As the fleet calls the machine.
  if (const auto& known = jobs_.at(job).known; known && !theirs.instance.empty()) theirs.instance = known->machine;
  // Failed or cancelled is this attempt; whether the job is, the queue says.
  if (is_final(theirs.state) && theirs.state != JobState::Done) return look_up(job);
  events_.jobs.job_changed(theirs);
}

void FleetRoute::on_refused(const std::string& fab, const std::string& id, const Error& why) {
  const std::string job = job_of(fab, id);
  if (job.empty()) return;
  // A fab that does not know this site's key gives the job back in a while, and another one may know it.
  if (why.code == ErrorCode::NotPermitted || why.code == ErrorCode::NotTrusted) {
    jobs_.at(job).why_refused = fmt::format("the fab {} does not take it: {}", fab, why.what);
    return events_.jobs.deferred(job, {});
  }
  // Unless the fleet has moved it meanwhile, no machine of its kind will take it.
  link_.ask<fleet::Job>(
      [job](FleetQueue& queue) { return queue.find(job); },
      [this, fab, id, job, why](const Result<fleet::Job>& now) {
        if (job_of(fab, id).empty()) return;
        if (!now) return on_known(job, now);
        if (fleet::is_final(now->state) || now->state == fleet::State::Waiting ||
            id_of_attempt(job, now->attempt) != id)
          return on_known(job, now);
        link_.ask<fleet::Job>(
            [job, site = options_.site](FleetQueue& queue) { return queue.cancel(job, site); },
            [](const Result<fleet::Job>&) {});  // where it fails its fab gives it back, and it fits none
        events_.jobs.refused(job, why);
      });
}

}  // namespace telefab::scan
