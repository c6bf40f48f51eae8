// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <filesystem>
#include <functional>
#include <map>
#include <memory>
#include <mutex>
#include <optional>
#include <set>
#include <string>
#include <telefab/base/clock.hpp>
#include <telefab/base/result.hpp>
#include <telefab/fab/print/light_fence.hpp>
#include <vector>

namespace telefab::fab {

/// How an attempt ended here. Words of it stand on disk.
enum class HoldEnd : std::uint8_t {
  None,       ///< it has not
  Done,       ///< printed
  Failed,     ///< it cannot be printed here, nor elsewhere
  Cancelled,  ///< somebody cancelled it here
  Released,   ///< given back without any light; another may print it
};
/// "none", "done", "failed", "cancelled", "released".
[[nodiscard]] std::string_view name_of(HoldEnd end);

/// What a fab knows of one job of the fleet, over restarts.
struct FleetHold {
  std::string job;                           ///< the fleet's id
  std::uint32_t attempt = 0;                 ///< the newest that was seen here
  std::string machine;                       ///< that it was leased for
  std::string site;                          ///< the scan site that offered it; empty: none has yet
  std::map<std::string, std::uint32_t> ids;  ///< attempt by the id that it has here as a job
  bool is_bound = false;                     ///< the newest attempt may be lit here, and nowhere else
  HoldEnd end = HoldEnd::None;               ///< of the newest attempt
  bool is_reported = false;                  ///< the fleet knows of that end
  friend bool operator==(const FleetHold&, const FleetHold&) = default;
};

/// Which jobs of the fleet (by their ids, is_job_id) this fab holds, a file a job in a folder, and until when it may
/// light them. The newest
/// attempt of a job is durable before anything of it is taken, and so is its binding before its first light. Leases
/// themselves are this life's alone: an unbound job is not lit before its lease was shown to hold in this life; a bound
/// one needs nobody. Threads: any.
class LeaseBook {
 public:
  /// Reads what there is; the folder is made with the first job. `clock`, of leases, must outlive the book. A file that
  /// cannot be read stands for a newer attempt than any: nothing of that job is lit (unreadable()). Fails with
  /// StorageFailed.
  [[nodiscard]] static Result<std::unique_ptr<LeaseBook>> open(std::filesystem::path folder, const Clock& clock);
  LeaseBook(const LeaseBook&) = delete;
  LeaseBook& operator=(const LeaseBook&) = delete;

  /// The files that could not be read, for people.
  [[nodiscard]] const std::vector<std::string>& unreadable() const { return unreadable_; }
  [[nodiscard]] std::optional<FleetHold> find(std::string_view fleet_job) const;
  /// The hold of a job of this fab by its id here, and the attempt that it is of. Nothing: it is no job of a fleet.
  struct Own {
    FleetHold hold;
    std::uint32_t attempt = 0;
    [[nodiscard]] bool is_newest() const { return attempt == hold.attempt; }
  };
  [[nodiscard]] std::optional<Own> own(std::string_view id) const;
  /// Those of whose end the fleet does not know, but for those whose file could not be read.
  [[nodiscard]] std::vector<FleetHold> unreported() const;

  // Durable when they return. StorageFailed: nothing has changed. Conflict: a newer attempt is known here.

  /// An attempt is this fab's, for one of its machines; `id`: of its job here. The same again changes nothing.
  [[nodiscard]] Result<void> hold(const std::string& fleet_job, std::uint32_t attempt, const std::string& id,
                                  const std::string& machine);
  /// Which scan site sends the layers. Conflict too where another one has offered it before.
  [[nodiscard]] Result<void> set_site(const std::string& fleet_job, std::uint32_t attempt, const std::string& site);
  /// The fleet has bound the attempt to this fab: it may be lit.
  [[nodiscard]] Result<void> bind(const std::string& fleet_job, std::uint32_t attempt);
  /// It has ended here and is not lit any more; the fleet is to hear of it.
  [[nodiscard]] Result<void> end(const std::string& fleet_job, std::uint32_t attempt, HoldEnd end);
  /// The fleet knows of its end.
  [[nodiscard]] Result<void> set_reported(const std::string& fleet_job, std::uint32_t attempt);

  // Of this life.

  /// The lease holds until then, Clock::now(), its safety margin taken off.
  void extend(const std::string& fleet_job, std::uint32_t attempt, Nanoseconds until);
  /// The fleet says that it is not this fab's any more, or somebody says so for it. One that was bound is not lit
  /// either until extend() says that it still is.
  void withdraw(const std::string& fleet_job, std::uint32_t attempt, FenceRefusal why);
  /// Whether an exposure would have leave now, without asking for anything. Of a job that is none of a fleet: Given.
  [[nodiscard]] Leave leave(std::string_view id) const;
  /// The fence of a job of this fab; null: it is no job of a fleet. The book must outlive it.
  [[nodiscard]] std::shared_ptr<LightFence> fence_of(std::string_view id);

  /// An attempt that is to be bound before its first light.
  struct Asked {
    std::string job;
    std::uint32_t attempt = 0;
  };
  /// What fences wait for.
  [[nodiscard]] std::vector<Asked> asked() const;
  /// Called, on a print's thread, when asked() has grown.
  void on_asked(std::function<void()> notify);

 private:
  class Fence;
  struct Lease {
    std::uint32_t attempt = 0;
    Nanoseconds until{};
    FenceRefusal withdrawn = FenceRefusal::None;
  };
  LeaseBook(std::filesystem::path folder, const Clock& clock) : folder_{std::move(folder)}, clock_{clock} {}
  /// mutex_ is held, or nobody else knows the book yet.
  void keep(FleetHold hold);
  /// mutex_ is held. Changes the hold of the newest attempt, on disk and then here.
  [[nodiscard]] Result<void> change(const std::string& fleet_job, std::uint32_t attempt,
                                    const std::function<Result<void>(FleetHold&)>& how);
  [[nodiscard]] const FleetHold* newest(std::string_view fleet_job) const;
  [[nodiscard]] std::optional<Own> own_locked(std::string_view id) const;
  [[nodiscard]] Leave leave_locked(const Own& own) const;
  [[nodiscard]] Leave ask(std::string_view id);

  std::filesystem::path folder_;
  const Clock& clock_;
  std::vector<std::string> unreadable_;
  mutable std::mutex mutex_;  ///< guards what follows, and the files
  std::map<std::string, FleetHold, std::less<>> holds_;
  std::set<std::string, std::less<>> unreported_;         ///< of holds_: there may be many more that have ended
  std::map<std::string, std::string, std::less<>> jobs_;  ///< the fleet's job by the id here
  std::map<std::string, Lease, std::less<>> leases_;
  std::set<std::string, std::less<>> asked_;
  std::function<void()> notify_;
};

}  // namespace telefab::fab
