// SPDX-License-Identifier: GPL-3.0-or-later
#include <algorithm>
#include <telefab/fab/print/machine_queue.hpp>

namespace telefab::fab {

MachineQueue::MachineQueue(std::vector<QueuedMachine> machines)
    : machines_{std::move(machines)}, states_(machines_.size()) {}

std::optional<std::size_t> MachineQueue::find(std::string_view machine) const {
  const auto found = std::ranges::find(machines_, machine, &QueuedMachine::name);
  if (found == machines_.end()) return std::nullopt;
  return static_cast<std::size_t>(found - machines_.begin());
}

void MachineQueue::add(const std::string& job, const std::vector<std::size_t>& fits, InTrouble in_trouble) {
  if (machine_of(job)) return;
  auto found = std::ranges::find(waiting_, job, &Waiting::job);
  if (found == waiting_.end()) found = waiting_.insert(waiting_.end(), {job, {}, {}});
  found->fits = {fits.begin(), fits.end()};
  found->in_trouble = in_trouble;
}

void MachineQueue::drop(const std::string& job) {
  std::erase_if(waiting_, [&](const Waiting& each) { return each.job == job; });
}

std::vector<Assignment> MachineQueue::assign() {
  std::vector<Assignment> made;
  for (const Waiting& each : waiting_) {
    const auto machine = choose(each);
    if (!machine) continue;
    State& state = states_[*machine];
    state.job = each.job;
    state.is_paused = state.is_lost = false;
    state.trouble = MachineTrouble::None;  // it is tried
    made.push_back({each.job, *machine});
  }
  for (const Assignment& each : made) drop(each.job);
  return made;
}

void MachineQueue::begin(const std::string& job, std::size_t machine) {
  if (!begun_on(job)) states_[machine].begun.insert(job);
}

void MachineQueue::forget_begun(const std::string& job) {
  for (State& state : states_) state.begun.erase(job);
}

void MachineQueue::release(const std::string& job, MachineTrouble trouble) {
  const auto machine = machine_of(job);
  if (!machine) return;
  State& state = states_[*machine];
  state.job.reset();
  state.is_paused = state.is_lost = false;
  state.trouble = trouble;
  state.troubled_by = job;
}

void MachineQueue::end(const std::string& job) {
  drop(job);
  if (const auto machine = machine_of(job)) states_[*machine].job.reset();
  for (State& state : states_) {
    state.begun.erase(job);
    if (state.troubled_by == job) state.trouble = MachineTrouble::None;  // another may try
  }
}

void MachineQueue::set_paused(const std::string& job, bool is_paused) {
  if (const auto machine = machine_of(job)) states_[*machine].is_paused = is_paused;
}

void MachineQueue::set_lost(const std::string& job, bool is_lost) {
  if (const auto machine = machine_of(job)) states_[*machine].is_lost = is_lost;
}

void MachineQueue::set_found(std::size_t machine, bool is_found) {
  State& state = states_[machine];
  if (state.job) return;
  if (is_found && state.trouble == MachineTrouble::Lost) state.trouble = MachineTrouble::None;
  if (!is_found && state.trouble == MachineTrouble::None) {
    state.trouble = MachineTrouble::Lost;
    state.troubled_by.clear();
  }
}

void MachineQueue::set_part(std::size_t machine, std::optional<std::string> job) {
  states_[machine].part = std::move(job);
}

void MachineQueue::forget_trouble(std::size_t machine) { states_[machine].trouble = MachineTrouble::None; }

MachineStanding MachineQueue::standing(std::size_t machine) const {
  const State& state = states_[machine];
  if (state.job && state.is_lost) return MachineStanding::Offline;
  if (state.job) return state.is_paused ? MachineStanding::Paused : MachineStanding::Printing;
  if (state.trouble == MachineTrouble::Lost) return MachineStanding::Offline;
  if (state.trouble == MachineTrouble::Fault) return MachineStanding::Fault;
  if (!state.begun.empty()) return MachineStanding::Paused;
  return state.part && machines_[machine].needs_clearing ? MachineStanding::Occupied : MachineStanding::Idle;
}

std::optional<std::string> MachineQueue::job_of(std::size_t machine) const {
  const State& state = states_[machine];
  if (state.job) return state.job;
  if (!state.begun.empty()) return *state.begun.begin();
  return machines_[machine].needs_clearing ? state.part : std::nullopt;
}

std::optional<std::size_t> MachineQueue::machine_of(const std::string& job) const {
  for (std::size_t each = 0; each < states_.size(); ++each)
    if (states_[each].job == job) return each;
  return std::nullopt;
}

std::optional<std::size_t> MachineQueue::begun_on(const std::string& job) const {
  for (std::size_t each = 0; each < states_.size(); ++each)
    if (states_[each].begun.contains(job)) return each;
  return std::nullopt;
}

bool MachineQueue::waits(const std::string& job) const {
  return std::ranges::find(waiting_, job, &Waiting::job) != waiting_.end();
}

std::vector<std::string> MachineQueue::waiting() const {
  std::vector<std::string> jobs;
  for (const Waiting& each : waiting_) jobs.push_back(each.job);
  return jobs;
}

std::size_t MachineQueue::waiting_for(std::size_t machine) const {
  return static_cast<std::size_t>(std::ranges::count_if(waiting_, [&](const Waiting& each) {
    const auto places = places_of(each);
    return std::ranges::find(places, machine) != places.end();
  }));
}

std::optional<Wait> MachineQueue::wait_of(const std::string& job) const {
  const auto found = std::ranges::find(waiting_, job, &Waiting::job);
  if (found == waiting_.end()) return std::nullopt;
  Wait wait;
  for (const std::size_t machine : places_of(*found)) {
    const auto reason = obstacle(job, machine);
    if (!reason) return Wait{WaitReason::Busy, machine};  // it gets that one as soon as somebody assigns
    if (!wait.machine || *reason < wait.reason) wait = {*reason, machine};
  }
  return wait;
}

std::optional<WaitReason> MachineQueue::obstacle(const std::string& job, std::size_t machine) const {
  const State& state = states_[machine];
  if (state.job) return WaitReason::Busy;
  if (state.begun.contains(job)) return std::nullopt;
  if (!state.begun.empty()) return WaitReason::Held;
  if (machines_[machine].needs_clearing && state.part && *state.part != job) return WaitReason::Platform;
  if (state.trouble != MachineTrouble::None) return WaitReason::Trouble;
  return std::nullopt;
}

std::vector<std::size_t> MachineQueue::places_of(const Waiting& waiting) const {
  if (const auto begun = begun_on(waiting.job)) return {*begun};
  return {waiting.fits.begin(), waiting.fits.end()};
}

std::optional<std::size_t> MachineQueue::choose(const Waiting& waiting) const {
  const auto places = places_of(waiting);
  for (const std::size_t machine : places)
    if (!obstacle(waiting.job, machine)) return machine;
  if (waiting.in_trouble == InTrouble::Waits) return std::nullopt;
  const bool is_all_trouble = !places.empty() && std::ranges::all_of(places, [&](std::size_t machine) {
    return obstacle(waiting.job, machine) == WaitReason::Trouble;
  });
  if (is_all_trouble) return places.front();
  return std::nullopt;
}

}  // namespace telefab::fab
