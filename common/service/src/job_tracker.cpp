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
  auto restored = open_or_restore(folder / "jobs.sqlite", clock);
  if (!restored) return tl::unexpected{restored.error()};
  auto audit = AuditLog::open(folder / "audit.log", clock);
  if (!audit) return tl::unexpected{audit.error()};
  auto notifier = StateHooks::start(hooks);
  if (!notifier) return tl::unexpected{notifier.error()};
  std::unique_ptr<JobTracker> tracker{
      new JobTracker{std::move(restored->store), std::move(*audit), std::move(*notifier), clock, loop, room}};
  if (!restored->notice.empty()) {
    log_warning(restored->notice);
    tracker->note("telefab", restored->notice);
    tracker->note_unlisted(folder / "jobs");
  }
  // A start goes on without a backup; the store itself is sound.
  warn_of(tracker->store().back_up());
  return tracker;
}

void JobTracker::note_unlisted(const std::filesystem::path& jobs) {
  std::error_code error;
  for (const auto& each : std::filesystem::directory_iterator{jobs, error})
    if (const auto found = store_->find(each.path().filename().string());
        !found && found.error().code == ErrorCode::NotFound)
      note("telefab", fmt::format("{} is of a job that is not in the list: the other site offers it again, or it is "
                                  "yours to look at and to remove",
                                  each.path().string()));
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
  if (room_ != nullptr) room_->go_on(job);
  save_in_order(job, [this, job, state, message = std::string{message}] { return save_move(job, state, message); });
}

void JobTracker::save_in_order(const std::string& job, Change change) {
  const std::lock_guard lock{mutex_};
  if (unsaved_.empty()) {
    auto saved = change();
    if (!saved && has_given_up_reserve()) saved = change();
    if (saved) return;
    log_warning(saved.error().what + "; tried again until it is kept", {job});
  }
  unsaved_.push_back(std::move(change));
  retry_later();
}

Result<void> JobTracker::save_move(const std::string& job, JobState state, const std::string& message) {
  const auto now = store_->find(job);
  if (!now && now.error().code == ErrorCode::StorageFailed) return tl::unexpected{now.error()};
  if (!now || (now->state == state && now->message == message)) return {};
  if (now->state != state && !may_follow(now->state, state)) return {};
  return report(job, store_->move(job, state, message));
}

Result<void> JobTracker::report(const std::string& job, const Result<Job>& moved) {
  if (!moved && moved.error().code == ErrorCode::StorageFailed) return tl::unexpected{moved.error()};
  if (!moved) {
    log_warning(moved.error().what, {job});
    return {};
  }
  log_line(fmt::format("job {} {}{}{}", job, name_of(moved->state), moved->message.empty() ? "" : ": ", moved->message),
           {job});
  hooks_->notify(*moved);
  return {};
}

void JobTracker::send_again(const std::string& job, std::string_view message) {
  save_in_order(job, [this, job, message = std::string{message}]() -> Result<void> {
    const auto now = store_->find(job);
    if (!now && now.error().code == ErrorCode::StorageFailed) return tl::unexpected{now.error()};
    if (!now || is_final(now->state) || !is_before(JobState::Sending, now->state)) return {};
    return report(job, store_->send_again(job, message));
  });
}

void JobTracker::retry_later() {
  if (std::exchange(is_retrying_, true)) return;
  loop_.post([this] { loop_.after(kRetryEvery, [this] { retry(); }); });
}

void JobTracker::retry() {
  const std::lock_guard lock{mutex_};
  while (!unsaved_.empty() && unsaved_.front()()) unsaved_.pop_front();
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
  save_in_order(job, [this, job, stage, seconds]() -> Result<void> {
    auto kept = store_->set_stage_seconds(job, stage, seconds);
    if (!kept && kept.error().code == ErrorCode::StorageFailed) return kept;
    warn_of(kept, {job});
    return {};
  });
}

void JobTracker::move(const std::string& job, JobState state, std::string_view message) {
  counters_.keep();
  // The other site is sent a job as it is stored: at its end, with the counters of its end.
  if (counters_.unkept(job))
    save_in_order(job, [this, job]() -> Result<void> {
      // As they are by then, and nothing where they are stored already: older ones never come over newer ones.
      const auto counters = counters_.unkept(job);
      if (!counters) return {};
      auto kept = store_->set_counters(job, *counters);
      return !kept && kept.error().code == ErrorCode::StorageFailed ? kept : Result<void>{};
    });
  record(job, state, message);
}

void JobTracker::wait_for_disk(const std::string& job, JobState state, const Error& why) {
  move(job, state, "waits: " + why.what);
  if (room_ != nullptr) room_->wait(job, why);
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
