// SPDX-License-Identifier: GPL-3.0-or-later
#include <telefab/fleet/fleet.hpp>

#include <algorithm>
#include <array>
#include <limits>
#include <tuple>

namespace telefab::fleet {
namespace {

constexpr std::array<std::string_view, 7> kStateNames{"waiting", "claimed", "bound",    "asking",
                                                      "done",    "failed",  "cancelled"};

std::int64_t deadline_of(const Job& job) {
  return job.deadline_unix_ms > 0 ? job.deadline_unix_ms : std::numeric_limits<std::int64_t>::max();
}

}  // namespace

std::string_view name_of(State state) { return kStateNames.at(static_cast<std::size_t>(state) - 1); }

bool is_final(State state) { return state == State::Done || state == State::Failed || state == State::Cancelled; }

bool is_seen(const Machine& machine, std::int64_t now_unix_ms) {
  return machine.seen_unix_ms >= now_unix_ms - kNotSeen_ms;
}

WhyNot why_not(const Job& job, const Machine& machine, std::int64_t now_unix_ms) {
  const Needs& needs = job.needs;
  if (is_final(job.state)) return WhyNot::Ended;
  if (job.state != State::Waiting) return WhyNot::HasMachine;
  if (!needs.machine.empty() && needs.machine != machine.name && needs.machine != machine.profile)
    return WhyNot::OtherMachine;
  if (!needs.light.empty() && needs.light != machine.light) return WhyNot::OtherLight;
  if (!needs.resin.empty() && needs.resin != machine.resin) return WhyNot::OtherResin;
  if (needs.width_mm > machine.width_mm || needs.depth_mm > machine.depth_mm || needs.height_mm > machine.height_mm)
    return WhyNot::TooLarge;
  if (needs.pixel_mm > 0 && machine.pixel_mm > needs.pixel_mm) return WhyNot::CoarserPixel;
  if (needs.calibrated_within_ms > 0 && machine.calibrated_unix_ms < now_unix_ms - needs.calibrated_within_ms)
    return WhyNot::CalibratedTooLongAgo;
  if (machine.is_draining) return WhyNot::Draining;
  if (!is_seen(machine, now_unix_ms)) return WhyNot::NotSeen;
  if (machine.readiness != Readiness::Free) return WhyNot::NotFree;
  return WhyNot::Fits;
}

bool is_before(const Job& a, const Job& b) {
  return std::tuple{-a.priority, deadline_of(a), a.place} < std::tuple{-b.priority, deadline_of(b), b.place};
}

std::vector<Placed> place(const std::vector<Job>& jobs, std::vector<Machine> machines, std::int64_t now_unix_ms) {
  std::vector<const Job*> order;
  for (const Job& job : jobs) order.push_back(&job);
  std::sort(order.begin(), order.end(), [](const Job* a, const Job* b) { return is_before(*a, *b); });
  std::sort(machines.begin(), machines.end(), [](const Machine& a, const Machine& b) { return a.name < b.name; });
  std::vector<Placed> placed;
  for (const Machine& machine : machines) {
    const auto fits = std::find_if(order.begin(), order.end(),
                                   [&](const Job* job) { return why_not(*job, machine, now_unix_ms) == WhyNot::Fits; });
    if (fits == order.end()) continue;
    placed.push_back({(*fits)->id, machine.name});
    order.erase(fits);
  }
  return placed;
}

std::vector<WhyNot> why_nots(const Job& job, const std::vector<Job>& jobs, const std::vector<Machine>& machines,
                             std::int64_t now_unix_ms) {
  const std::vector<Placed> placed = place(jobs, machines, now_unix_ms);
  std::vector<WhyNot> all;
  for (const Machine& machine : machines) {
    WhyNot why = why_not(job, machine, now_unix_ms);
    // Free and fit, it takes this job, or one that comes before it; or another machine was quicker to take this one.
    const auto taken = std::ranges::find(placed, machine.name, &Placed::machine);
    if (why == WhyNot::Fits && (taken == placed.end() || taken->job != job.id)) {
      const auto other =
          taken == placed.end() ? jobs.end() : std::ranges::find(jobs, taken->job, [](const Job& j) { return j.id; });
      why = other != jobs.end() && is_before(*other, job) ? WhyNot::LaterInOrder : WhyNot::GoesElsewhere;
    }
    all.push_back(why);
  }
  return all;
}

}  // namespace telefab::fleet
