// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <map>
#include <mutex>
#include <telefab/fab/planning/plan_job.hpp>
#include <telefab/fab/support/part_regions.hpp>
#include <telefab/service/site.hpp>
#include <telefab/service/work_queue.hpp>

#include "job_dispatcher.hpp"
#include "plan_print.hpp"

namespace telefab::fab {

/// Plans jobs one after the other on the thread "planner"; then the printer has them, and the thread "predictor",
/// behind everything else, computes what their masks will cure. Threads: the loop's.
class JobPlanner {
 public:
  /// Both must outlive it. `options`: of every job; name, registration and regions are its own.
  JobPlanner(Site& site, PlanOptions options, JobDispatcher& dispatcher);
  ~JobPlanner();
  JobPlanner(const JobPlanner&) = delete;
  JobPlanner& operator=(const JobPlanner&) = delete;

  /// A job whose layers are all here. `analysis`: of these layers, where they came in since the start; null otherwise.
  void add(const std::string& job, std::shared_ptr<LayerStream> analysis);
  /// A job that waits for approval and is in no journal is planned again with another list of supports by hand, and
  /// waits for approval then. The plan before stands until the new one is whole, and for good where that cannot be
  /// made. Fails: Conflict (the job is elsewhere; says where), StorageFailed.
  [[nodiscard]] Result<Job> plan_again(const std::string& job, const HandList& supports, const std::string& who);
  /// A job that is planned; nothing is computed where that was done before.
  void predict(const std::string& job) { predictor_.add(job); }
  /// Nothing is planned or computed for the job any more. True where something was under way, which ends soon.
  bool drop(const std::string& job);
  void ask_to_end();

 private:
  /// On the planner's thread.
  void plan(const std::string& job, std::stop_token stop);
  [[nodiscard]] Result<PlanOutcome> attempt(const std::string& job, std::stop_token stop);
  [[nodiscard]] std::shared_ptr<const PartRegions> take_analysed(const std::string& job, std::uint32_t layers);
  /// On the predictor's thread.
  void compute_accuracy(const std::string& job, std::stop_token stop);
  [[nodiscard]] Result<void> attempt_accuracy(const std::string& job, const std::stop_token& stop);
  /// The new plan is there: what was computed of the one before is void.
  void replaced(const std::filesystem::path& folder, const std::string& job);
  /// No new plan can be made: the one before waits for approval as it did. False where there is none.
  [[nodiscard]] bool stays_as_before(const std::string& job, const Error& why);
  /// The job waits, says why, and is tried again; nothing of it is lost.
  void wait(const std::string& job, const Error& why);
  void count(const std::string& job, std::uint32_t done, std::uint32_t all);

  Site& site_;
  PlanOptions options_;
  JobDispatcher& dispatcher_;
  std::mutex mutex_;
  std::map<std::string, std::shared_ptr<LayerStream>> analysed_;  ///< of jobs to be planned; guarded by mutex_
  WorkQueue predictor_;
  WorkQueue queue_;
};

}  // namespace telefab::fab
