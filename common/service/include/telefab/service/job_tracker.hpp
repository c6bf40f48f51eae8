// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <deque>
#include <filesystem>
#include <map>
#include <mutex>
#include <telefab/service/disk_room.hpp>
#include <telefab/service/live_counters.hpp>
#include <telefab/service/state_hooks.hpp>
#include <telefab/store/audit_log.hpp>
#include <telefab/store/job_store.hpp>
#include <vector>

namespace telefab {

/// Every change of a site's jobs goes through here: into the store, the audit log and the log, to the hooks, and to
/// whoever works on a job and must know that it is at its end.
class JobTracker {
 public:
  /// jobs.sqlite, which is checked, restored where it is damaged and backed up, and audit.log in `folder`. Fails as
  /// JobStore, AuditLog and StateHooks do. Clock, loop and room must outlive it. `room`: its reserve is given up for
  /// what cannot be written otherwise, and it hears which jobs wait; may be null.
  [[nodiscard]] static Result<std::unique_ptr<JobTracker>> open(const std::filesystem::path& folder,
                                                                const HookOptions& hooks, const Clock& clock,
                                                                net::Loop& loop, DiskRoom* room = nullptr);
  ~JobTracker();
  JobTracker(const JobTracker&) = delete;
  JobTracker& operator=(const JobTracker&) = delete;

  // ---- any thread ----
  [[nodiscard]] JobStore& store() { return *store_; }
  /// Who did what, or was refused what: into log and audit log. What cannot be written is tried again every second.
  void note(std::string_view who, std::string_view what);
  /// Moves a job where that is a change and may be; logs it and calls the hooks. What cannot be stored is tried again
  /// every second, in order, until it is; JobStore::health() says so meanwhile.
  void record(const std::string& job, JobState state, std::string_view message);
  /// Tried again as record() does.
  void set_stage_seconds(const std::string& job, JobStage stage, double seconds);

  // ---- the loop's thread ----
  /// How far the jobs under way are.
  [[nodiscard]] LiveCounters& counters() { return counters_; }
  /// Stores the counters as they are, then records the move.
  void move(const std::string& job, JobState state, std::string_view message);
  /// A job of a fleet that another fab is to print is sent once more; nothing where it is not sent yet, or has ended.
  void send_again(const std::string& job, std::string_view message);
  /// The job waits for the disk: it says why, and the site's health does until the job's next move.
  void wait_for_disk(const std::string& job, JobState state, const Error& why);
  /// Moves a job to a state that is final; whoever works on it forgets it, and then its counters are forgotten.
  void end(const std::string& job, JobState state, std::string_view message);
  /// Called with every job that end() ends, in the order of these calls.
  void on_end(std::function<void(const std::string& job)> forget) { forgetters_.push_back(std::move(forget)); }
  /// The stage begins now, also where it had begun before.
  void begin_stage(const std::string& job, JobStage stage);
  /// Stores how long the stage took; nothing where it did not begin since the site started.
  void end_stage(const std::string& job, JobStage stage);

 private:
  /// A change of the store; where it fails, it is tried again.
  using Change = std::function<Result<void>()>;
  struct UnsavedNote {
    std::string who, what;
    Nanoseconds wall;
  };
  JobTracker(std::unique_ptr<JobStore> store, std::unique_ptr<AuditLog> audit, std::unique_ptr<StateHooks> hooks,
             const Clock& clock, net::Loop& loop, DiskRoom* room);

  std::unique_ptr<JobStore> store_;
  std::unique_ptr<AuditLog> audit_;
  std::unique_ptr<StateHooks> hooks_;
  /// Now, or behind whatever is not stored yet: a change may follow from one before it.
  void save_in_order(const std::string& job, Change change);
  [[nodiscard]] Result<void> save_move(const std::string& job, JobState state, const std::string& message);
  /// What came of a change of a job's state: logged, and the hooks hear of it. Fails where it is to be tried again.
  [[nodiscard]] Result<void> report(const std::string& job, const Result<Job>& moved);
  /// Folders of jobs that a restored store does not know.
  void note_unlisted(const std::filesystem::path& jobs);
  void retry_later();
  void retry();
  /// Whether there is room now that was not there before.
  [[nodiscard]] bool has_given_up_reserve() { return room_ != nullptr && room_->give_up_reserve(); }

  const Clock& clock_;
  net::Loop& loop_;
  DiskRoom* room_;
  std::mutex mutex_;            ///< what is unsaved, and the order of moves
  std::deque<Change> unsaved_;  ///< in the order they were made
  std::deque<UnsavedNote> unsaved_notes_;
  bool is_retrying_ = false;
  bool has_unkept_counters_ = false;  ///< the loop's thread only
  LiveCounters counters_;
  std::vector<std::function<void(const std::string&)>> forgetters_;
  std::map<std::string, std::map<JobStage, Nanoseconds>> began_;  ///< by job
};

}  // namespace telefab
