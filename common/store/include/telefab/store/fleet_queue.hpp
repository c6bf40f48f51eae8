// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <filesystem>
#include <memory>
#include <optional>
#include <span>
#include <telefab/base/clock.hpp>
#include <telefab/base/result.hpp>
#include <telefab/fleet/fleet.hpp>

namespace telefab {

/// The one durable queue of a fleet: machines of several fabs, jobs of several scan sites, and who has which. Beside
/// the sites' own stores, never instead of them; it holds no layer and no scan. Two forms: a SQLite file for the
/// daemons of one computer, PostgreSQL for many. Each call is one transaction; what is changed is checked by what was
/// there when it was changed, never by what was read before. Leases are judged by the clock of the queue alone, so that
/// clocks of sites may be wrong by hours. Threads: one; calls may wait for the database, so none is made on a network
/// thread. Fails, all methods: Unreachable (the database is away; the next call tries again), StorageFailed, NotTrusted
/// (the file is damaged, or the server is not who it should be), NotPermitted (the role may not do that), NotFound (no
/// such job or machine).
class FleetQueue {
 public:
  virtual ~FleetQueue() = default;
  FleetQueue(const FleetQueue&) = delete;
  FleetQueue& operator=(const FleetQueue&) = delete;

  /// A fab and all its machines as they are now; machines of it that are not among them go, but for those with a lease.
  /// Whether a machine drains stays as it is. Conflict: a machine of that name stands in another fab.
  [[nodiscard]] virtual Result<void> announce(const fleet::Fab& fab, std::span<const fleet::Machine> machines) = 0;
  /// By name.
  [[nodiscard]] virtual Result<std::vector<fleet::Fab>> fabs() = 0;
  [[nodiscard]] virtual Result<std::vector<fleet::Machine>> machines() = 0;
  /// Takes a machine out of service, or puts it back: what it has goes on.
  [[nodiscard]] virtual Result<void> drain(std::string_view machine, bool is_draining, std::string_view who) = 0;

  /// Every copy, the first first. The same id and needs again change nothing. Conflict: the id is another job's.
  [[nodiscard]] virtual Result<std::vector<fleet::Job>> submit(const fleet::NewJob& job) = 0;
  /// In the order of submission; empty states: any. Only those of a place above `after`, at most `most`.
  [[nodiscard]] virtual Result<std::vector<fleet::Job>> jobs(std::span<const fleet::State> states, std::uint64_t after,
                                                             std::size_t most) = 0;
  [[nodiscard]] virtual Result<fleet::Job> find(std::string_view job) = 0;
  /// Conflict: it is at its end, or bound: then it is cancelled at its fab.
  [[nodiscard]] virtual Result<fleet::Job> cancel(std::string_view job, std::string_view who) = 0;

  /// The first waiting job that fits one of the machines becomes that one's for `lasts`, with the next attempt; nothing
  /// where none does. Of several that it fits the first by name. Machines that have a job are passed over. Conflict:
  /// all of them have.
  [[nodiscard]] virtual Result<std::optional<fleet::Lease>> claim(std::span<const std::string> machines,
                                                                  Nanoseconds lasts) = 0;
  [[nodiscard]] Result<std::optional<fleet::Lease>> claim(std::string_view machine, Nanoseconds lasts) {
    const std::string one{machine};
    return claim(std::span{&one, 1}, lasts);
  }
  /// Nothing: the lease is over, and another may have the job.
  [[nodiscard]] virtual Result<std::optional<fleet::Lease>> renew(std::string_view job, std::uint32_t attempt,
                                                                  Nanoseconds lasts) = 0;
  /// Before its first light: the job is that machine's from now on. False: the lease is over.
  [[nodiscard]] virtual Result<bool> bind(std::string_view job, std::uint32_t attempt) = 0;
  /// A job of which nothing is lit waits again. False: the lease is over, or bound.
  [[nodiscard]] virtual Result<bool> release(std::string_view job, std::uint32_t attempt, std::string_view why) = 0;
  /// Its end; `state` is final. False: the lease is over.
  [[nodiscard]] virtual Result<bool> finish(std::string_view job, std::uint32_t attempt, fleet::State state,
                                            std::string_view message) = 0;
  /// Leases of a machine, to go on with after a restart of its fab.
  [[nodiscard]] virtual Result<std::vector<fleet::Lease>> leases_of(std::string_view machine) = 0;
  /// Leases that ran out: what is not bound waits again, what is bound asks. How many.
  [[nodiscard]] virtual Result<std::size_t> expire() = 0;
  /// What somebody decides of a job that asks: Waiting (the part is lost, it is made again), Done or Failed. Conflict:
  /// it does not ask.
  [[nodiscard]] virtual Result<fleet::Job> decide(std::string_view job, fleet::State state, std::string_view who) = 0;

  /// Once for each key, however often it is added: a site repeats what was not acknowledged.
  [[nodiscard]] virtual Result<void> add_event(std::string_view key, const fleet::Event& event) = 0;
  /// With a number above `after`, oldest first.
  [[nodiscard]] virtual Result<std::vector<fleet::Event>> events(std::uint64_t after, std::size_t most) = 0;
  /// The newest, oldest of them first.
  [[nodiscard]] virtual Result<std::vector<fleet::Event>> newest_events(std::size_t most) = 0;
  /// Waits until an event was added, or for so long; whether one may have been.
  [[nodiscard]] virtual Result<bool> wait(Nanoseconds longest) = 0;
  /// By the clock of the queue.
  [[nodiscard]] virtual Result<std::int64_t> now_unix_ms() = 0;

 protected:
  FleetQueue() = default;
};

/// The queue in a SQLite file, made where there is none, and checked. InvalidInput: a file of another program or of a
/// newer version. The clock must outlive it.
[[nodiscard]] Result<std::unique_ptr<FleetQueue>> open_fleet_file(const std::filesystem::path& path,
                                                                  const Clock& clock);
/// The queue in PostgreSQL; tables are made where the role may. `uri`: as libpq takes it,
/// postgresql://USER@HOST/DATABASE?sslmode=verify-full. InvalidInput: it is none, it holds a password (which belongs
/// into ~/.pgpass, PGPASSFILE or a service file), or the tables are of a newer version.
[[nodiscard]] Result<std::unique_ptr<FleetQueue>> open_fleet_database(const std::string& uri);
/// By the form of its name: sqlite:PATH, or postgresql://... InvalidInput: neither.
[[nodiscard]] Result<std::unique_ptr<FleetQueue>> open_fleet(const std::string& where, const Clock& clock);

}  // namespace telefab
