// SPDX-License-Identifier: GPL-3.0-or-later
#include "fleet_agent.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <nlohmann/json.hpp>
#include <telefab/base/json_text.hpp>
#include <telefab/service/log.hpp>
#include <telefab/service/profile_choice.hpp>

namespace telefab::fab {
namespace {

constexpr Nanoseconds kLease = std::chrono::seconds{30};
/// An unbound job is not lit in the last part of its lease: what is asked and answered takes time.
constexpr Nanoseconds kMargin = std::chrono::seconds{5};
constexpr Nanoseconds kRenewEvery = std::chrono::seconds{8};
constexpr Nanoseconds kLookEvery = std::chrono::seconds{1};
constexpr Nanoseconds kAnnounceEvery = std::chrono::seconds{10};
/// A job whose scan site does not come goes back, and another of the fleet's machines may have it first.
constexpr Nanoseconds kLayersWithin = std::chrono::minutes{2};
constexpr Nanoseconds kRestAfterGivenBack = std::chrono::minutes{1};

std::optional<HoldEnd> end_of(JobState state) {
  switch (state) {
    case JobState::Done:
      return HoldEnd::Done;
    case JobState::Failed:
      return HoldEnd::Failed;
    case JobState::Cancelled:
      return HoldEnd::Cancelled;
    default:
      return std::nullopt;
  }
}

fleet::State state_of(HoldEnd end) {
  if (end == HoldEnd::Done) return fleet::State::Done;
  return end == HoldEnd::Failed ? fleet::State::Failed : fleet::State::Cancelled;
}

/// The profiles that one can submit for, as fleet::Fab keeps them.
std::string catalogue_of(const ProfileCatalogue& profiles) {
  const Machines known = to_machines(profiles, "");
  return json_text(
      {{"machine_toml", known.machine_toml}, {"resin_toml", known.resin_toml}, {"print_toml", known.print_toml}});
}

/// The id here of the newest attempt.
std::string newest_id(const FleetHold& hold) { return id_of_attempt(hold.job, hold.attempt); }

}  // namespace

FleetAgent::FleetAgent(Site& site, FabMembership membership, LeaseBook& leases, JobDispatcher& dispatcher)
    : site_{site},
      membership_{std::move(membership)},
      leases_{leases},
      dispatcher_{dispatcher},
      link_{site.loop(), [this] { return membership_.opened(site_.clock()); }, [this] { look(); }} {
  leases_.on_asked([this, alive = alive_] {
    site_.loop().post([this, alive] {
      if (*alive) look();
    });
  });
}

FleetAgent::~FleetAgent() {
  leases_.on_asked({});
  *alive_ = false;
}

void FleetAgent::begin(std::uint16_t port) {
  catalogue_ = catalogue_of(site_.profiles());
  if (membership_.address.empty()) {
    const std::string& listen = site_.options().listen;
    membership_.address = fmt::format("{}:{}", listen.substr(0, listen.rfind(':')), port);
  }
  tick();
}

void FleetAgent::tick() {
  if (link_.why_away() != why_away_) {
    why_away_ = link_.why_away();
    log_line(
        why_away_.empty()
            ? "the queue of the fleet is reached"
            : fmt::format("the queue of the fleet is away, prints go on and no new job is claimed: {}", why_away_));
  }
  look();
  site_.loop().after(kLookEvery, [this, alive = alive_] {
    if (*alive) tick();
  });
}

void FleetAgent::look() {
  // Many changes are one look.
  if (std::exchange(is_look_due_, true)) return;
  site_.loop().post([this, alive = alive_] {
    if (!*alive) return;
    is_look_due_ = false;
    announce();
    for (const LeaseBook::Asked& asked : leases_.asked()) bind(asked);
    for (const FleetHold& hold : leases_.unreported()) {
      if (hold.end == HoldEnd::None) look_for_end(hold);
      if (hold.end == HoldEnd::None && has_old_leases_) renew(hold);
      if (hold.end != HoldEnd::None) report(hold);
    }
    if (!has_old_leases_ || is_ending_) return;
    claim();
  });
}

// ---- machines ------------------------------------------------------------------------------------------------------

std::string FleetAgent::fleet_name(const std::string& machine) const { return membership_.name + "-" + machine; }

bool FleetAgent::is_free(const MachineStatus& machine) const {
  if (machine.state != MachineState::Idle || machine.waiting > 0) return false;
  const auto rest = not_before_.find(machine.name);
  if (rest != not_before_.end() && now() < rest->second) return false;
  // The queue gives a machine no other job before it knows how the last one ended.
  return std::ranges::none_of(leases_.unreported(),
                              [&](const FleetHold& hold) { return hold.machine == machine.name && !hold.is_reported; });
}

std::vector<fleet::Machine> FleetAgent::machines() const {
  std::vector<fleet::Machine> all;
  const FabMachines& stand = dispatcher_.machines();
  const auto standing = dispatcher_.standing();
  for (std::size_t place = 0; place < stand.size(); ++place) {
    const MachineProfile& profile = stand.profile(place);
    fleet::Machine machine;
    machine.name = fleet_name(stand[place].name);
    machine.fab = membership_.name;
    machine.profile = stand[place].profile;
    // Cut for a machine means cut for its profile with its resin, whatever its devices are.
    machine.light = light_of(site_.profiles(), stand[place].profile, stand.composed(place).resin);
    machine.resin = standing[place].resin;
    machine.pixel_mm = profile.projection.pixel_pitch_mm;
    machine.width_mm = profile.platform.width_mm;
    machine.depth_mm = profile.platform.depth_mm;
    machine.height_mm = profile.platform.z_travel_mm;
    switch (standing[place].state) {
      case MachineState::Idle:
        machine.readiness = is_free(standing[place]) ? fleet::Readiness::Free : fleet::Readiness::Busy;
        break;
      case MachineState::Printing:
      case MachineState::Paused:
        machine.readiness = fleet::Readiness::Busy;
        break;
      case MachineState::Occupied:
        machine.readiness = fleet::Readiness::Occupied;
        break;
      case MachineState::Fault:
      case MachineState::Offline:
        machine.readiness = fleet::Readiness::Trouble;
        break;
    }
    all.push_back(std::move(machine));
  }
  return all;
}

void FleetAgent::announce() {
  if (is_announcing_) return;
  auto known = machines();
  if (known == announced_ && now() - announced_at_ < kAnnounceEvery) return;
  is_announcing_ = true;
  fleet::Fab fab{membership_.name, membership_.address, membership_.certificate, catalogue_};
  link_.ask<bool>(
      [fab = std::move(fab), known](FleetQueue& queue) -> Result<bool> {
        auto kept = queue.announce(fab, known);
        if (kept) kept = queue.expire().map([](std::size_t) {});
        return kept.map([] { return true; });
      },
      [this, known](const Result<bool>& kept) {
        is_announcing_ = false;
        if (!kept) {
          if (announced_at_ != Nanoseconds{} || kept.error().code != ErrorCode::Unreachable)
            log_warning("the fleet: " + kept.error().what);
          announced_at_ = Nanoseconds{};
          announced_.clear();
          return;
        }
        announced_ = known;
        announced_at_ = now();
        if (!has_old_leases_)
          for (const QueuedMachine& machine : dispatcher_.stand()) resume_leases(machine.name);
      });
}

// ---- leases --------------------------------------------------------------------------------------------------------

void FleetAgent::extend(const std::string& job, std::uint32_t attempt, Nanoseconds asked, std::int64_t left_ms) {
  const Nanoseconds left = std::min<Nanoseconds>(std::chrono::milliseconds{left_ms}, kLease);
  leases_.extend(job, attempt, asked + left - kMargin);
}

void FleetAgent::resume_leases(const std::string& machine) {
  const Nanoseconds asked = now();
  link_.ask<std::vector<fleet::Lease>>(
      [name = fleet_name(machine)](FleetQueue& queue) { return queue.leases_of(name); },
      [this, machine, asked](const Result<std::vector<fleet::Lease>>& known) {
        if (!known) return;  // asked again with the next announcement
        for (const fleet::Lease& lease : *known) on_claimed(machine, lease, asked);
        has_old_leases_ = true;
      });
}

void FleetAgent::claim() {
  std::map<std::string, std::string> free;  // machines here, by their names in the fleet
  for (const MachineStatus& machine : dispatcher_.standing())
    if (is_free(machine)) free[fleet_name(machine.name)] = machine.name;
  if (free.empty() || std::exchange(is_claiming_, true)) return;
  std::vector<std::string> names;
  for (const auto& [name, machine] : free) names.push_back(name);
  const Nanoseconds asked = now();
  link_.ask<std::optional<fleet::Lease>>(
      [names = std::move(names)](FleetQueue& queue) { return queue.claim(names, kLease); },
      [this, free = std::move(free), asked](const Result<std::optional<fleet::Lease>>& got) {
        is_claiming_ = false;
        if (!got && got.error().code != ErrorCode::Unreachable)
          log_warning(fmt::format("the fleet: no job is claimed: {}", got.error().what));
        if (!got || !*got) return;
        on_claimed(free.at((*got)->machine), **got, asked);
        look();  // another one may fit the next
      });
}

void FleetAgent::on_claimed(const std::string& machine, const fleet::Lease& lease, Nanoseconds asked) {
  const std::string id = id_of_attempt(lease.job, lease.attempt);
  Result<void> held = fail(ErrorCode::InvalidInput, fmt::format("the fleet names a job {}", lease.job));
  if (fleet_job_of(id, lease.attempt) == lease.job) held = leases_.hold(lease.job, lease.attempt, id, machine);
  if (!held) {
    log_warning(fmt::format("the fleet: {}", held.error().what), {id});
    return link_.ask<bool>(
        [lease, why = held.error().what](FleetQueue& queue) { return queue.release(lease.job, lease.attempt, why); },
        [](const Result<bool>&) {});  // where even that fails its lease runs out
  }
  const auto hold = leases_.find(lease.job);
  if (hold->end != HoldEnd::None) return;  // it is reported, again and again
  extend(lease.job, lease.attempt, asked, lease.left_ms);
  asking_[lease.job] = {false, false, false, asked, now()};
  site_.tracker().note("fleet",
                       fmt::format("attempt {} of job {} is leased for {}", lease.attempt, lease.job, machine));
  for (const auto& [own, attempt] : hold->ids) dispatcher_.lease_changed(own);  // what is older ends
}

void FleetAgent::renew(const FleetHold& hold) {
  Asking& asking = asking_[hold.job];
  if (asking.is_renewed || (asking.renewed != Nanoseconds{} && now() - asking.renewed < kRenewEvery)) return;
  asking.is_renewed = true;
  const Nanoseconds asked = now();
  link_.ask<std::optional<fleet::Lease>>(
      [hold](FleetQueue& queue) { return queue.renew(hold.job, hold.attempt, kLease); },
      [this, hold, asked](const Result<std::optional<fleet::Lease>>& got) {
        Asking& answered = asking_[hold.job];
        answered.is_renewed = false;
        if (!got && got.error().code != ErrorCode::NotFound) return;  // the lease runs on, and perhaps out
        answered.renewed = asked;
        if (!got || !*got) return on_lost(hold);
        extend(hold.job, hold.attempt, asked, (*got)->left_ms);
        dispatcher_.lease_changed(newest_id(hold));
      });
}

void FleetAgent::on_lost(const FleetHold& before) {
  // It may have been bound or have ended while that was asked.
  const auto hold = leases_.find(before.job);
  if (!hold || hold->attempt != before.attempt || hold->end != HoldEnd::None) return;
  if (!hold->is_bound) return withdraw(*hold, FenceRefusal::LeaseEnded);
  // Bound, the part is this machine's until somebody decides otherwise.
  link_.ask<fleet::Job>([job = hold->job](FleetQueue& queue) { return queue.find(job); },
                        [this, hold = *hold](const Result<fleet::Job>& job) {
                          if (!job && job.error().code != ErrorCode::NotFound) return;
                          const bool is_own = job && job->attempt == hold.attempt &&
                                              (job->state == fleet::State::Bound || job->state == fleet::State::Asking);
                          if (!is_own) withdraw(hold, FenceRefusal::Superseded);
                        });
}

void FleetAgent::withdraw(const FleetHold& hold, FenceRefusal why) {
  leases_.withdraw(hold.job, hold.attempt, why);
  const std::string id = newest_id(hold);
  log_warning(fmt::format("the fleet has ended the lease of attempt {} of job {}{}", hold.attempt, hold.job,
                          hold.is_bound ? ", whose print had begun: it goes dark with its next layer" : ""),
              {id});
  // Nobody is to hear of this end: the queue has said so itself.
  for (const auto& kept :
       {leases_.end(hold.job, hold.attempt, HoldEnd::Released), leases_.set_reported(hold.job, hold.attempt)})
    if (!kept) return log_warning(kept.error().what, {id});  // asked again with the next renewal
  dispatcher_.lease_changed(id);
}

void FleetAgent::bind(const LeaseBook::Asked& asked) {
  Asking& asking = asking_[asked.job];
  if (std::exchange(asking.is_bound, true)) return;
  link_.ask<bool>([asked](FleetQueue& queue) { return queue.bind(asked.job, asked.attempt); },
                  [this, asked](const Result<bool>& bound) {
                    asking_[asked.job].is_bound = false;
                    if (!bound) return;  // asked again with the next look
                    const auto hold = leases_.find(asked.job);
                    if (!hold || hold->attempt != asked.attempt) return;
                    if (!*bound) return on_lost(*hold);
                    if (auto kept = leases_.bind(asked.job, asked.attempt); !kept)
                      return log_warning(kept.error().what, {newest_id(*hold)});  // stays dark, and is asked again
                    dispatcher_.lease_changed(newest_id(*hold));
                  });
}

// ---- ends ----------------------------------------------------------------------------------------------------------

void FleetAgent::look_for_end(const FleetHold& hold) {
  const std::string id = newest_id(hold);
  const auto job = store().find(id);
  if (job) {
    const auto end = end_of(job->state);
    if (!end) return;
    if (auto kept = leases_.end(hold.job, hold.attempt, *end); !kept) log_warning(kept.error().what, {id});
    return;
  }
  if (job.error().code != ErrorCode::NotFound) return;
  Asking& asking = asking_[hold.job];
  if (asking.since == Nanoseconds{}) asking.since = now();
  if (now() - asking.since > kLayersWithin)
    give_back(hold, fmt::format("its scan site brought no layers to {}", membership_.name));
}

void FleetAgent::give_back(const FleetHold& hold, const std::string& why) {
  not_before_[hold.machine] = now() + kRestAfterGivenBack;
  log_warning(fmt::format("job {} goes back to the fleet: {}", hold.job, why), {newest_id(hold)});
  if (auto kept = leases_.end(hold.job, hold.attempt, HoldEnd::Released); !kept)
    log_warning(kept.error().what, {newest_id(hold)});
}

void FleetAgent::report(const FleetHold& hold) {
  Asking& asking = asking_[hold.job];
  if (std::exchange(asking.is_ended, true)) return;
  const auto job = store().find(newest_id(hold));
  link_.ask<bool>(
      [hold, message = job ? job->message : std::string{}](FleetQueue& queue) {
        if (hold.end == HoldEnd::Released)
          return queue.release(hold.job, hold.attempt, "given back by its fab before any light");
        return queue.finish(hold.job, hold.attempt, state_of(hold.end), message);
      },
      [this, hold](const Result<bool>& known) {
        asking_[hold.job].is_ended = false;
        // One that is not this fab's any more, or that the queue does not know, has nobody who waits for it.
        if (!known && known.error().code != ErrorCode::NotFound) return;
        if (auto kept = leases_.set_reported(hold.job, hold.attempt); !kept)
          return log_warning(kept.error().what, {newest_id(hold)});
        asking_.erase(hold.job);
        look();
      });
}

}  // namespace telefab::fab
