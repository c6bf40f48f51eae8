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
  std::string id_prefix = {};  ///< of an id that is made: what other sites make is then another one
};

/// The jobs of one site, in SQLite (one file, write-ahead log, every change fsynced): after kill -9 or power loss each
/// job is as its last answered call left it. Statements keep to what PostgreSQL understands too.
/// Threads: every method may be called from several threads. The clock must outlive the store.
/// Fails, all methods: StorageFailed (disk full, not readable; the message names the file), NotTrusted (the file is
/// damaged), NotFound (no such job).
class JobStore {
 public:
  /// Makes the file where there is none, and brings one of an older version up to this one, a copy of it kept beside as
  /// PATH.schema-N. Checks it whole. Fails with InvalidInput for a file of another program or a newer version.
  [[nodiscard]] static Result<std::unique_ptr<JobStore>> open(const std::filesystem::path& path, const Clock& clock);
  ~JobStore();
  JobStore(const JobStore&) = delete;
  JobStore& operator=(const JobStore&) = delete;

  /// Conflict where the given id is taken already.
  [[nodiscard]] Result<Job> create(const NewJob& job);
  [[nodiscard]] Result<Job> find(std::string_view id) const;
  [[nodiscard]] Result<JobPage> list(const JobQuery& query) const;
  /// Every job that is not final, and the newest `most` of all; newest first.
  [[nodiscard]] Result<std::vector<Job>> current(std::size_t most) const;
  /// Jobs that are not final, oldest first: what to resume after a restart.
  [[nodiscard]] Result<std::vector<Job>> unfinished() const;

  /// Conflict, and nothing changes, where may_follow forbids it; the same state again only changes the message.
  /// The change and its message become an event.
  [[nodiscard]] Result<Job> move(std::string_view id, JobState to, std::string_view message);
  /// A job of a fleet that another fab prints: back to Sending from whatever it was behind that. Conflict: it has
  /// ended.
  [[nodiscard]] Result<Job> send_again(std::string_view id, std::string_view message);
  [[nodiscard]] Result<void> set_counters(std::string_view id, const JobCounters& counters);
  [[nodiscard]] Result<void> set_stage_seconds(std::string_view id, JobStage stage, double seconds);
  /// The machine that the job is on, or none where empty; a change becomes an event.
  [[nodiscard]] Result<void> set_instance(std::string_view id, std::string_view instance);
  [[nodiscard]] Result<void> add_event(std::string_view id, std::string_view text);
  /// Events of a job with a number above `after`, oldest first, at most `most`.
  [[nodiscard]] Result<std::vector<JobEvent>> events(std::string_view id, std::uint64_t after, std::size_t most) const;

  /// Jobs that are final, the one that ended first first.
  [[nodiscard]] Result<std::vector<Job>> ended() const;
  /// Takes a job that is final off the list, with its events, and keeps only that there was one of this id: it is not
  /// made again. Conflict for one that is not final.
  [[nodiscard]] Result<Job> forget(std::string_view id);
  /// How a job ended that was forgotten; nothing: none was of this id.
  [[nodiscard]] Result<std::optional<JobState>> forgotten(std::string_view id) const;

  /// Writes a copy of the file as it is now, whole or not at all, as PATH.backup-1; the copies before become -2 and so
  /// on, kStoreBackups of them.
  [[nodiscard]] Result<void> back_up();

  /// Why the last change could not be kept; nothing is wrong once one could be again.
  [[nodiscard]] Result<void> health() const;
  /// Grows with every change; for watchers that poll.
  [[nodiscard]] std::uint64_t revision() const;

 private:
  struct Impl;
  explicit JobStore(std::unique_ptr<Impl> impl);
  std::unique_ptr<Impl> impl_;
};

inline constexpr int kStoreBackups = 3;

/// A store that was opened, and what had to be done for it.
struct RestoredStore {
  std::unique_ptr<JobStore> store;
  std::string notice;  ///< for people; empty: nothing had to be done
};
/// Opens the store; a damaged one is set aside as PATH.damaged-N, and the newest sound backup takes its place, or an
/// empty store where there is none. Fails as JobStore::open does but for damage.
[[nodiscard]] Result<RestoredStore> open_or_restore(const std::filesystem::path& path, const Clock& clock);

}  // namespace telefab
