// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <filesystem>
#include <memory>
#include <optional>
#include <telefab/base/clock.hpp>
#include <telefab/job/job.hpp>

namespace telefab {

/// What a new job starts with.
struct NewJob {
  std::optional<std::string> id;  ///< the other site's id for the same job; otherwise one is made
  std::string name;
  std::string machine;
  std::string parameters = "{}";
  std::string owner;
};

/// The jobs of one site, in SQLite (one file, write-ahead log, every change fsynced): after kill -9 or power loss each
/// job is as its last answered call left it. Statements keep to what PostgreSQL understands too.
/// Threads: every method may be called from several threads. The clock must outlive the store.
/// Fails, all methods: StorageFailed (disk full, damaged file; the message names the file), NotFound (no such job).
class JobStore {
 public:
  /// Makes the file where there is none. Fails with InvalidInput for a file of another program or a newer version.
  [[nodiscard]] static Result<std::unique_ptr<JobStore>> open(const std::filesystem::path& path, const Clock& clock);
  ~JobStore();
  JobStore(const JobStore&) = delete;
  JobStore& operator=(const JobStore&) = delete;

  /// Conflict where the given id is taken already.
  [[nodiscard]] Result<Job> create(const NewJob& job);
  [[nodiscard]] Result<Job> find(std::string_view id) const;
  /// Newest first, at most `most`.
  [[nodiscard]] Result<std::vector<Job>> list(std::size_t most) const;
  /// Jobs that are not final, oldest first: what to resume after a restart.
  [[nodiscard]] Result<std::vector<Job>> unfinished() const;

  /// Conflict, and nothing changes, where may_follow forbids it; the same state again only changes the message.
  /// The change and its message become an event.
  [[nodiscard]] Result<Job> move(std::string_view id, JobState to, std::string_view message);
  [[nodiscard]] Result<void> set_counters(std::string_view id, const JobCounters& counters);
  [[nodiscard]] Result<void> set_stage_seconds(std::string_view id, JobStage stage, double seconds);
  [[nodiscard]] Result<void> add_event(std::string_view id, std::string_view text);
  /// Events of a job with a number above `after`, oldest first, at most `most`.
  [[nodiscard]] Result<std::vector<JobEvent>> events(std::string_view id, std::uint64_t after, std::size_t most) const;

  /// Why the last change could not be kept; nothing is wrong once one could be again.
  [[nodiscard]] Result<void> health() const;
  /// Grows with every change; for watchers that poll.
  [[nodiscard]] std::uint64_t revision() const;

 private:
  struct Impl;
  explicit JobStore(std::unique_ptr<Impl> impl);
  std::unique_ptr<Impl> impl_;
};

}  // namespace telefab
