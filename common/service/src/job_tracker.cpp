// SPDX-License-Identifier: GPL-3.0-or-later
#include <fmt/format.h>

#include <telefab/service/job_tracker.hpp>
#include <telefab/service/log.hpp>
#include <utility>

namespace telefab {
namespace {

constexpr auto kRetryEvery = std::chrono::seconds{1};
constexpr std::size_t kMostUnsavedNotes = 1000;

/// A daemon goes on where its books cannot be written, and says so.
void warn_of(const Result<void>& outcome, const LogFields& fields = {}) {
  if (!outcome) log_warning(outcome.error().what, fields);
}

}  // namespace

JobTracker::JobTracker(std::unique_ptr<JobStore> store, std::unique_ptr<AuditLog> audit,
                       std::unique_ptr<StateHooks> hooks, const Clock& clock, net::Loop& loop, DiskRoom* room)
    : store_{std::move(store)},
      audit_{std::move(audit)},
      hooks_{std::move(hooks)},
      clock_{clock},
      loop_{loop},
      room_{room},
      counters_{loop, [this](const std::string& job, const JobCounters& counters) {
                  const auto kept = store_->set_counters(job, counters);
                  // Said once, however often it is tried again.
                  if (!std::exchange(has_unkept_counters_, !kept)) warn_of(kept, {job});
                  return kept || kept.error().code != ErrorCode::StorageFailed;
                }} {}

JobTracker::~JobTracker() = default;

Result<std::unique_ptr<JobTracker>> JobTracker::open(const std::filesystem::path& folder, const HookOptions& hooks,
                                                     const Clock& clock, net::Loop& loop, DiskRoom* room) {
  auto store = JobStore::open(folder / "jobs.sqlite", clock);
  if (!store) return tl::unexpected{store.error()};
  auto audit = AuditLog::open(folder / "audit.log", clock);
  if (!audit) return tl::unexpected{audit.error()};
  auto notifier = StateHooks::start(hooks);
  if (!notifier) return tl::unexpected{notifier.error()};
  return std::unique_ptr<JobTracker>{
      new JobTracker{std::move(*store), std::move(*audit), std::move(*notifier), clock, loop, room}};
}

void JobTracker::note(std::string_view who, std::string_view what) {
  log_line(fmt::format("{}: {}", who, what));
  const std::lock_guard lock{mutex_};
  if (unsaved_notes_.empty()) {
    auto added = audit_->add(who, what);
    if (!added && has_given_up_reserve()) added = audit_->add(who, what);
    if (added) return;
    log_warning(added.error().what);
  }
  if (unsaved_notes_.size() == kMostUnsavedNotes) return;  // the log has them all
  unsaved_notes_.push_back({std::string{who}, std::string{what}, clock_.wall()});
  retry_later();
}

void JobTracker::record(const std::string& job, JobState state, std::string_view message) {
  const std::lock_guard lock{mutex_};
  Unsaved move{job, state, std::string{message}};
  if (unsaved_.empty()) {
    auto saved = save(move);
    if (!saved && has_given_up_reserve()) saved = save(move);
    if (saved) return;
    log_warning(saved.error().what + "; tried again until it is kept", {job});
  }
  // Behind the others: a move that is not stored yet may be what this one follows.
  unsaved_.push_back(std::move(move));
  retry_later();
}

Result<void> JobTracker::save(const Unsaved& move) {
  const auto now = store_->find(move.job);
  if (!now && now.error().code == ErrorCode::StorageFailed) return tl::unexpected{now.error()};
  if (!now || (now->state == move.state && now->message == move.message)) return {};
  if (now->state != move.state && !may_follow(now->state, move.state)) return {};
  const auto moved = store_->move(move.job, move.state, move.message);
  if (!moved && moved.error().code == ErrorCode::StorageFailed) return tl::unexpected{moved.error()};
  if (!moved) {
    log_warning(moved.error().what, {move.job});
    return {};
  }
  log_line(fmt::format("job {} {}{}{}", move.job, name_of(move.state), move.message.empty() ? "" : ": ", move.message),
           {move.job});
  hooks_->notify(*moved);
  return {};
}

void JobTracker::retry_later() {
  if (std::exchange(is_retrying_, true)) return;
  loop_.post([this] { loop_.after(kRetryEvery, [this] { retry(); }); });
}

void JobTracker::retry() {
  const std::lock_guard lock{mutex_};
  while (!unsaved_.empty() && save(unsaved_.front())) unsaved_.pop_front();
  while (!unsaved_notes_.empty()) {
    const UnsavedNote& note = unsaved_notes_.front();
    const auto late = std::chrono::duration_cast<std::chrono::seconds>(clock_.wall() - note.wall).count();
    if (!audit_->add(note.who, fmt::format("{} (written {} s late)", note.what, late))) break;
    unsaved_notes_.pop_front();
  }
  is_retrying_ = false;
  if (!unsaved_.empty() || !unsaved_notes_.empty()) retry_later();
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
