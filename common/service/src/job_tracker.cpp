// SPDX-License-Identifier: GPL-3.0-or-later
#include <fmt/format.h>

#include <telefab/service/job_tracker.hpp>
#include <telefab/service/log.hpp>

namespace telefab {
namespace {

/// A daemon goes on where its books cannot be written, and says so.
void warn_of(const Result<void>& outcome, const LogFields& fields = {}) {
  if (!outcome) log_warning(outcome.error().what, fields);
}

}  // namespace

JobTracker::JobTracker(std::unique_ptr<JobStore> store, std::unique_ptr<AuditLog> audit,
                       std::unique_ptr<StateHooks> hooks, const Clock& clock, net::Loop& loop)
    : store_{std::move(store)},
      audit_{std::move(audit)},
      hooks_{std::move(hooks)},
      clock_{clock},
      counters_{loop, [this](const std::string& job, const JobCounters& counters) {
                  warn_of(store_->set_counters(job, counters), {job});
                }} {}

JobTracker::~JobTracker() = default;

Result<std::unique_ptr<JobTracker>> JobTracker::open(const std::filesystem::path& folder, const HookOptions& hooks,
                                                     const Clock& clock, net::Loop& loop) {
  auto store = JobStore::open(folder / "jobs.sqlite", clock);
  if (!store) return tl::unexpected{store.error()};
  auto audit = AuditLog::open(folder / "audit.log", clock);
  if (!audit) return tl::unexpected{audit.error()};
  auto notifier = StateHooks::start(hooks);
  if (!notifier) return tl::unexpected{notifier.error()};
  return std::unique_ptr<JobTracker>{
      new JobTracker{std::move(*store), std::move(*audit), std::move(*notifier), clock, loop}};
}

void JobTracker::note(std::string_view who, std::string_view what) {
  log_line(fmt::format("{}: {}", who, what));
  warn_of(audit_->add(who, what));
}

void JobTracker::record(const std::string& job, JobState state, std::string_view message) {
  const auto now = store_->find(job);
  if (!now || (now->state == state && now->message == message)) return;
  if (now->state != state && !may_follow(now->state, state)) return;
  const auto moved = store_->move(job, state, message);
  if (!moved) return log_warning(moved.error().what, {job});
  log_line(fmt::format("job {} {}{}{}", job, name_of(state), message.empty() ? "" : ": ", message), {job});
  hooks_->notify(*moved);
}

void JobTracker::set_stage_seconds(const std::string& job, JobStage stage, double seconds) {
  warn_of(store_->set_stage_seconds(job, stage, seconds), {job});
}

void JobTracker::move(const std::string& job, JobState state, std::string_view message) {
  counters_.keep();
  record(job, state, message);
}

void JobTracker::end(const std::string& job, JobState state, std::string_view message) {
  move(job, state, message);
  for (const auto& forget : forgetters_) forget(job);
  counters_.end(job);
  began_.erase(job);
}

void JobTracker::begin_stage(const std::string& job, JobStage stage) { began_[job][stage] = clock_.now(); }

void JobTracker::end_stage(const std::string& job, JobStage stage) {
  const auto stages = began_.find(job);
  if (stages == began_.end()) return;
  const auto began = stages->second.extract(stage);
  if (began.empty()) return;
  set_stage_seconds(job, stage, std::chrono::duration<double>(clock_.now() - began.mapped()).count());
}

}  // namespace telefab
