// SPDX-License-Identifier: GPL-3.0-or-later
#include "job_intake.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <telefab/fab/planning/plan_room.hpp>
#include <telefab/service/log.hpp>
#include <telefab/service/profile_choice.hpp>
#include <telefab/service/saved_message.hpp>
#include <telefab/wire/job_signature.hpp>

#include "job_room.hpp"
#include "print_orders.hpp"
#include "upload.hpp"

namespace telefab::fab {
namespace {

constexpr auto kOfferedAgainWithin = std::chrono::seconds{5};
constexpr std::size_t kMostPutOff = 1000;  ///< beyond them health() has enough to say

}  // namespace

JobIntake::JobIntake(Site& site, SiteKeys keys, StartPolicy policy, JobPlanner& planner, LeaseBook& leases,
                     InFleet in_fleet)
    : site_{site},
      keys_{std::move(keys)},
      policy_{policy},
      planner_{planner},
      leases_{leases},
      in_fleet_{in_fleet},
      shelf_{site.folder().path() / "stacks"} {
  tracker().on_end([this](const std::string& job) {
    live_.erase(job);
    taken_over_.erase(job);
    to_be_sent_.erase(job);
  });
}

Result<std::optional<OfferDeferred>> JobIntake::check_attempt(const Offer& offer, const std::string& site) {
  const auto may_be_taken = std::optional<OfferDeferred>{};
  if (offer.attempt == 0) {
    if (!leases_.own(offer.job)) return may_be_taken;
    return fail(ErrorCode::Conflict, fmt::format("fleet-attempt: job {} is a fleet's, and is offered without its "
                                                 "attempt",
                                                 offer.job));
  }
  const std::string fleet_job = fleet_job_of(offer.job, offer.attempt).value_or(offer.job);
  const auto hold = leases_.find(fleet_job);
  if (hold && hold->attempt > offer.attempt)
    return fail(ErrorCode::Conflict,
                fmt::format("fleet-attempt: attempt {} of job {} is over, attempt {} is known here", offer.attempt,
                            fleet_job, hold->attempt));
  if (!hold && in_fleet_ == InFleet::No)
    return fail(ErrorCode::NotPermitted,
                "fleet-attempt: this fab is in no fleet; start it with --fleet, or submit the job to it alone");
  // The lease may be told here later than there.
  if (!hold || hold->attempt < offer.attempt || hold->end == HoldEnd::Released)
    return put_off(offer.job, DeferReason::Busy,
                   fmt::format("it has no lease of attempt {} of job {}", offer.attempt, fleet_job));
  if (auto kept = leases_.set_site(fleet_job, offer.attempt, site); !kept) {
    if (!is_storage_trouble(kept.error())) return tl::unexpected{kept.error()};
    return put_off(offer.job, DeferReason::StorageFault, kept.error().what);
  }
  return may_be_taken;
}

Result<StackReceiver::OfferAnswer> JobIntake::take_offer(const Offer& offer, const net::Peer& peer) {
  const std::string& site = peer.name;
  const auto signer = keys_.check(offer, peer);
  if (!signer) return tl::unexpected{signer.error()};
  if (const auto known = site_.profiles().compose({offer.machine}); !known) return tl::unexpected{known.error()};
  const auto job = site_.store().find(offer.job);
  if (!job && job.error().code != ErrorCode::NotFound)
    return put_off(offer.job, DeferReason::StorageFault, job.error().what);
  if (!job)
    if (const auto before = site_.store().forgotten(offer.job); before && *before)
      return fail(ErrorCode::Conflict, fmt::format("replayed-job: job {} ended here as {}, and was forgotten",
                                                   offer.job, name_of(**before)));
  if (job && job->owner != site)
    return fail(ErrorCode::Conflict, fmt::format("replayed-job: there is a job {} of another site", offer.job));
  auto deferred = check_attempt(offer, site);
  if (!deferred) return tl::unexpected{deferred.error()};
  if (*deferred) return std::move(**deferred);
  if (job && is_before(JobState::Sending, job->state)) {
    const auto before = saved_offer(site_.folder().path() / "jobs" / offer.job);
    if (!before && is_storage_trouble(before.error()))
      return put_off(offer.job, DeferReason::StorageFault, before.error().what);
    if (!before || to_frame(*before) != to_frame(offer))
      return fail(ErrorCode::Conflict, fmt::format("replayed-job: job {} was another one", offer.job));
    return std::shared_ptr<Intake>{};
  }
  // Of what is here already nothing is asked again: another resin in the vat is a matter of its print.
  const auto machine = profile_of_job(site_.profiles(), offer.machine, offer.parameters);
  if (!machine) return tl::unexpected{machine.error()};
  if (offer.profile != digest_of_profile(*machine) || offer.header.machine != machine->name)
    return fail(
        ErrorCode::Conflict,
        fmt::format(
            "the profile of {} was changed since the scan was cut, or the sites are of two releases; submit it again",
            machine->name));
  const auto live = live_.find(offer.job);
  if (live == live_.end() || !live->second.intake) {
    const auto room = site_.room().check(offer_room_bytes(offer.header));
    if (!room && room.error().code == ErrorCode::TooLarge) return tl::unexpected{room.error()};
    if (!room) return put_off(offer.job, DeferReason::Full, room.error().what);
  }
  auto intake = open_intake(offer, *machine, site, *signer);
  if (intake) return *intake;
  if (!is_storage_trouble(intake.error())) return tl::unexpected{intake.error()};
  return put_off(offer.job, DeferReason::StorageFault, intake.error().what);
}

OfferDeferred JobIntake::put_off(const std::string& job, DeferReason reason, const std::string& why) {
  // What the intake holds in memory may be ahead of what is stored.
  if (reason != DeferReason::Busy) live_.erase(job);
  const std::string what =
      fmt::format("the fab is {}: {}", reason == DeferReason::StorageFault ? "in trouble" : name_of(reason), why);
  const auto retry_after = std::min(site_.options().retry_every, kLongestDeferral);
  const auto now = site_.store().find(job);
  const bool is_listed = now && now->state == JobState::Sending;
  if (reason == DeferReason::Busy) {
    if (is_listed) tracker().move(job, JobState::Sending, "waits: " + what);
    return {job, reason, retry_after, what};
  }
  const Error waits{ErrorCode::StorageFailed, what};
  if (is_listed)
    tracker().wait_for_disk(job, JobState::Sending, waits);
  else if (put_off_.contains(job) || put_off_.size() < kMostPutOff)
    site_.room().wait(job, waits);
  else
    return {job, reason, retry_after, what};
  expect_again(job, 2 * retry_after + kOfferedAgainWithin);
  return {job, reason, retry_after, what};
}

void JobIntake::expect_again(const std::string& job, Nanoseconds within) {
  const std::uint64_t times = ++put_off_[job];
  site_.loop().after(within, [this, job, times] {
    const auto last = put_off_.find(job);
    if (last == put_off_.end() || last->second != times) return;
    put_off_.erase(last);
    site_.room().go_on(job);
  });
}

Result<std::shared_ptr<Intake>> JobIntake::open_intake(const Offer& offer, const MachineProfile& machine,
                                                       const std::string& site, const std::string& signer) {
  const auto folder = site_.folder().job(offer.job);
  if (!folder) return tl::unexpected{folder.error()};
  auto job = site_.store().find(offer.job);
  if (!job) {
    job = site_.store().create({offer.job, offer.name, offer.machine, offer.parameters, site});
    if (!job) return tl::unexpected{job.error()};
    tracker().note(
        site, fmt::format("offer {} {} for {} by {}, {}", offer.job, offer.name, offer.machine, offer.owner, signer));
  }
  Live& live = live_[offer.job];
  if (!live.intake) {
    if (auto looked = look_for_layers(offer, site, *folder); !looked) return tl::unexpected{looked.error()};
    auto analysis = std::make_shared<LayerStream>(machine);
    auto intake = Intake::open(*folder, offer, [analysis](const Layer& layer) { analysis->add(layer); });
    if (!intake) return tl::unexpected{intake.error()};
    // Layers that are whole already were not shown to it.
    if (!intake->is_whole()) live.analysis = std::move(analysis);
    live.intake = std::make_shared<Intake>(std::move(*intake));
    tracker().begin_stage(offer.job, JobStage::Send);
    tracker().counters().begin(offer.job, job->counters);
  } else if (to_frame(live.intake->offer()) != to_frame(offer)) {
    return fail(ErrorCode::Conflict, fmt::format("replayed-job: job {} is another one", offer.job));
  }
  tracker().counters().change(offer.job, [&](JobCounters& c) {
    c.layers = offer.header.layer_count;
    c.layers_sent = live.intake->spool().layer_count();
  });
  tracker().move(offer.job, JobState::Sending, "");
  auto intake = live.intake;
  if (intake->is_complete()) completed(offer.job);
  return intake;
}

Result<void> JobIntake::look_for_layers(const Offer& offer, const std::string& site,
                                        const std::filesystem::path& folder) {
  // Of a fleet's alone: whoever sends a job again by hand may want to see it sent.
  if (offer.attempt == 0 || to_be_sent_.contains(offer.job)) return {};
  const auto other = shelf_.job_with(offer);
  if (!other) return {};
  const auto theirs = site_.store().find(*other);
  if (!theirs || theirs->owner != site) return {};
  const auto taken = take_over_stack(offer, site_.folder().path() / "jobs" / *other, folder);
  if (!taken) return tl::unexpected{taken.error()};
  if (!*taken) return {};
  taken_over_.insert(offer.job);
  tracker().note(site, fmt::format("the layers of job {} are here as those of job {}", offer.job, *other));
  return {};
}

std::optional<OfferDeferred> JobIntake::send_again(const std::string& job) {
  if (taken_over_.erase(job) == 0) return std::nullopt;
  to_be_sent_.insert(job);
  const auto folder = site_.folder().path() / "jobs" / job;
  std::error_code error;
  std::filesystem::remove(folder / "chunks", error);
  if (!error) std::filesystem::remove(folder / "end", error);
  if (error) return put_off(job, DeferReason::StorageFault, error.message());
  live_.erase(job);
  return put_off(job, DeferReason::Busy, "the layers that were here are not those of the job; they are sent");
}

void JobIntake::received(const std::string& job, std::uint32_t layers, std::uint64_t bytes) {
  tracker().counters().change(job, [&](JobCounters& c) {
    c.layers_sent = layers;
    c.wire_bytes += bytes;
  });
}

void JobIntake::completed(const std::string& job) {
  const auto live = live_.find(job);
  const auto now = site_.store().find(job);
  if (live == live_.end() || !now || is_before(JobState::Sending, now->state)) return;
  taken_over_.erase(job);
  // Without it the same layers are sent once more, and nothing is wrong.
  if (live->second.intake && live->second.intake->offer().attempt > 0)
    if (auto kept = shelf_.put(live->second.intake->offer()); !kept) log_warning(kept.error().what, {job});
  live->second.intake.reset();
  tracker().end_stage(job, JobStage::Send);
  tracker().move(job, JobState::Planning, "");
  planner_.add(job, std::move(live->second.analysis));
}

Result<Job> JobIntake::take_upload(const NewJob& upload) {
  const auto folder = site_.folder().job(*upload.id);
  if (!folder) return tl::unexpected{folder.error()};
  const auto offer = saved_offer(*folder);
  const bool is_to_trace = has_ready_print(*folder);  // its layers are not known yet
  if (!offer && !is_to_trace) return tl::unexpected{offer.error()};
  auto job = site_.store().create(upload);
  if (!job) return job;
  tracker().note(upload.owner,
                 fmt::format("upload {} {} for {} {}", job->id, job->name, job->machine, upload.parameters));
  live_[job->id] = {};
  tracker().begin_stage(job->id, JobStage::Send);
  tracker().counters().begin(job->id, job->counters);
  tracker().counters().change(job->id, [&](JobCounters& c) {
    if (is_to_trace) return;
    c.layers = c.layers_sent = offer->header.layer_count;
    if (const auto spool = ChunkSpool::open(*folder / "chunks")) c.wire_bytes = spool->payload_bytes();
  });
  completed(job->id);
  return site_.store().find(job->id);
}

void JobIntake::broken(const std::string& job, const Error& why) { tracker().end(job, JobState::Failed, why.what); }

Result<void> JobIntake::resume(const Job& job) {
  live_[job.id] = {};
  const auto folder = site_.folder().job(job.id);
  if (!folder) return tl::unexpected{folder.error()};
  const auto before = start_case(*folder, job, LightOf::Fab);
  if (!before) return tl::unexpected{before.error()};
  if (before->facts.order.order == Order::Cancel) {
    tracker().end(job.id, JobState::Cancelled, fmt::format("by {}", before->facts.order.by));
    return {};
  }
  // The word by which it would print by itself once planned is as old as its last change.
  StartFacts facts;
  facts.order = {Order::GoOn, kAutomatic, {}};
  facts.last_sign = std::chrono::milliseconds{job.changed_unix_ms};
  if (may_light_at_start(facts, false, policy_, site_.clock().wall()).ruling != StartRuling::GoOn)
    if (auto held = hold_for_approval(*folder); !held) return held;
  if (job.state == JobState::Planning) {
    planner_.add(job.id, nullptr);
    return {};
  }
  // A scan site will offer its job again; nobody would an upload, whose layers are all here.
  const auto intake = Intake::reopen(*folder);
  if ((intake && intake->is_complete()) || has_ready_print(*folder)) completed(job.id);
  return {};
}

}  // namespace telefab::fab
