// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <filesystem>
#include <telefab/service/state_hooks.hpp>
#include <telefab/store/audit_log.hpp>
#include <telefab/store/job_store.hpp>

namespace telefab {

/// What a daemon writes down: jobs, audit log, log lines; and who hears of a change. Threads: any.
class JobTracker {
 public:
  /// jobs.sqlite and audit.log in `folder`. Fails as JobStore, AuditLog and StateHooks do. The clock must outlive it.
  [[nodiscard]] static Result<std::unique_ptr<JobTracker>> open(const std::filesystem::path& folder,
                                                                const HookOptions& hooks, const Clock& clock);
  [[nodiscard]] JobStore& store() { return *store_; }
  /// Who did what, or was refused what: into log and audit log.
  void note(std::string_view who, std::string_view what);
  /// Moves a job where that is a change and may be; logs it and tells the hooks.
  void move(const std::string& job, JobState state, std::string_view message);
  void set_stage_seconds(const std::string& job, JobStage stage, double seconds);
  void set_counters(const std::string& job, const JobCounters& counters);

 private:
  JobTracker(std::unique_ptr<JobStore> store, std::unique_ptr<AuditLog> audit, std::unique_ptr<StateHooks> hooks)
      : store_{std::move(store)}, audit_{std::move(audit)}, hooks_{std::move(hooks)} {}
  std::unique_ptr<JobStore> store_;
  std::unique_ptr<AuditLog> audit_;
  std::unique_ptr<StateHooks> hooks_;
};

}  // namespace telefab
