// SPDX-License-Identifier: GPL-3.0-or-later
#include <fmt/format.h>

#include <algorithm>

#include "job_dispatcher.hpp"

// Which jobs of a fleet may print here, and where.
namespace telefab::fab {
namespace {

constexpr auto kLeaveLookEvery = std::chrono::seconds{1};

}  // namespace

FabMachines::Fits JobDispatcher::fits(const Job& job) const {
  auto found = machines_.fits(job);
  const auto own = leases_.own(job.id);
  if (!own || found.places.empty()) return found;
  std::erase_if(found.places, [&](std::size_t place) { return machines_[place].name != own->hold.machine; });
  if (found.places.empty())
    found.why_none = fmt::format(
        "the fleet has it printed on {}, which does not stand here or does not fit it any more", own->hold.machine);
  return found;
}

bool JobDispatcher::has_leave(const Job& job) {
  if (only_watched_.contains(job.id)) return true;  // its printer was asked already
  const Leave leave = leases_.leave(job.id);
  for_lease_.erase(job.id);
  if (leave.state != LeaveState::Refused) return true;
  queue_.drop(job.id);
  if (leave.why == FenceRefusal::Superseded) {
    tracker().end(job.id, JobState::Cancelled, leave.what);
    return false;
  }
  for_lease_.insert(job.id);
  const std::string why = fmt::format("waits for the fleet: {}", leave.what);
  if (may_wait(job) && job.message != why) tracker().move(job.id, job.state, why);
  return false;
}

void JobDispatcher::wait_for_leave(const std::string& job) {
  const auto now = store().find(job);
  if (!now || !may_wait(*now) || queue_.waits(job) || queue_.machine_of(job)) return;
  // The question is on its way, and nothing moves before it is answered.
  if (leases_.leave(job).state != LeaveState::Awaited) return wait_for_machine(job);
  if (!for_leave_.insert(job).second) return;
  site_.loop().after(kLeaveLookEvery, [this, job] {
    for_leave_.erase(job);
    if (!is_ending_) wait_for_leave(job);
  });
}

void JobDispatcher::lease_changed(const std::string& job) {
  const auto now = store().find(job);
  if (!now || is_final(now->state)) return;
  // What is under way asks its fence by itself, and what waits for an operator goes on waiting for one.
  const bool is_over = leases_.leave(job).why == FenceRefusal::Superseded;
  if (JobPrinter* const printer = printer_of(job)) {
    if (!is_over || printer->control_of(job)) return;
    printer->take_off(job);
  }
  if (is_over) return tracker().end(job, JobState::Cancelled, leases_.leave(job).what);
  // Only what was let print and waits for its lease alone: nothing prints here on the fleet's word.
  if (for_lease_.contains(job) && may_wait(*now)) wait_for_machine(job);
}

}  // namespace telefab::fab
