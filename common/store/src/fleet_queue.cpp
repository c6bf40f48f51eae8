// SPDX-License-Identifier: GPL-3.0-or-later
#include <telefab/store/fleet_queue.hpp>

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>

#include "fleet_postgres.hpp"
#include "fleet_rows.hpp"
#include "fleet_sqlite.hpp"

namespace telefab {
namespace {

using fleet::Readiness;
using fleet::State;

constexpr std::int64_t kVersion = 1;
constexpr std::uint32_t kMostCopies = 1000;

/// {0}: FleetSql::numbered().
constexpr const char* kTables[] = {
    "CREATE TABLE fleet_version (version INTEGER NOT NULL)",
    "CREATE TABLE fab (name TEXT PRIMARY KEY, address TEXT NOT NULL, certificate TEXT NOT NULL, catalogue TEXT NOT "
    "NULL)",
    "CREATE TABLE machine (name TEXT PRIMARY KEY, fab TEXT NOT NULL REFERENCES fab (name), profile TEXT NOT NULL, "
    "light "
    "TEXT NOT NULL, resin TEXT NOT NULL, width_mm DOUBLE PRECISION NOT NULL, depth_mm DOUBLE PRECISION NOT NULL, "
    "height_mm DOUBLE PRECISION NOT NULL, pixel_mm DOUBLE PRECISION NOT NULL, calibrated_unix_ms BIGINT NOT NULL, "
    "readiness INTEGER NOT NULL, is_draining INTEGER NOT NULL DEFAULT 0, seen_unix_ms BIGINT NOT NULL)",
    "CREATE TABLE fleet_job (place {0}, id TEXT NOT NULL UNIQUE, name TEXT NOT NULL, owner TEXT NOT NULL, site TEXT "
    "NOT "
    "NULL, asks_for TEXT NOT NULL, light TEXT NOT NULL, resin TEXT NOT NULL, width_mm DOUBLE PRECISION NOT NULL, "
    "depth_mm DOUBLE PRECISION NOT NULL, height_mm DOUBLE PRECISION NOT NULL, pixel_mm DOUBLE PRECISION NOT NULL, "
    "calibrated_within_ms BIGINT NOT NULL, priority INTEGER NOT NULL, deadline_unix_ms BIGINT NOT NULL, stack_key TEXT "
    "NOT NULL, state INTEGER NOT NULL, attempt BIGINT NOT NULL DEFAULT 0, machine TEXT NOT NULL DEFAULT '', message "
    "TEXT "
    "NOT NULL DEFAULT '')",
    "CREATE INDEX fleet_job_in_order ON fleet_job (state, priority DESC, deadline_unix_ms, place)",
    "CREATE TABLE lease (job TEXT PRIMARY KEY REFERENCES fleet_job (id), machine TEXT NOT NULL UNIQUE REFERENCES "
    "machine (name), attempt BIGINT NOT NULL, until_unix_ms BIGINT NOT NULL, is_bound INTEGER NOT NULL DEFAULT 0)",
    "CREATE TABLE fleet_event (number {0}, key TEXT UNIQUE, unix_ms BIGINT NOT NULL, job TEXT NOT NULL, "
    "machine "
    "TEXT NOT NULL, text TEXT NOT NULL)",
};

constexpr const char* kJobs = "FROM fleet_job f LEFT JOIN lease l ON l.job = f.id";

/// That job j fits machine m, as fleet::why_not has it; {0}: now, {1}: kNotSeen_ms.
constexpr const char* kFits =
    "j.state = 1 AND (j.asks_for = '' OR j.asks_for = m.name OR j.asks_for = m.profile) AND (j.light = '' OR j.light = "
    "m.light) AND (j.resin = '' OR j.resin = m.resin) AND j.width_mm <= m.width_mm AND j.depth_mm <= m.depth_mm AND "
    "j.height_mm <= m.height_mm AND (j.pixel_mm <= 0 OR m.pixel_mm <= j.pixel_mm) AND (j.calibrated_within_ms <= 0 OR "
    "m.calibrated_unix_ms >= {0} - j.calibrated_within_ms) AND m.is_draining = 0 AND m.seen_unix_ms >= {0} - {1} AND "
    "m.readiness = 1";

std::int64_t ms_of(Nanoseconds time) { return std::chrono::duration_cast<std::chrono::milliseconds>(time).count(); }
std::int64_t number_of(State state) { return static_cast<std::int64_t>(state); }

std::string copy_name(const std::string& id, std::uint32_t copy) {
  return copy == 1 ? id : fmt::format("{}-c{}", id, copy);
}

class SqlFleetQueue final : public FleetQueue {
 public:
  explicit SqlFleetQueue(std::unique_ptr<FleetSql> sql) : sql_{std::move(sql)} {}

  /// Makes the tables, or brings them up.
  Result<void> prepare() {
    return together([&]() -> Result<void> {
      const auto version = sql_->version();
      if (!version) return tl::unexpected{version.error()};
      if (*version > kVersion)
        return fail(ErrorCode::InvalidInput,
                    fmt::format("{} is of a newer version of Telefab (schema {}, this one reads up to {}); start that "
                                "version",
                                sql_->name(), *version, kVersion));
      if (*version == kVersion) return {};
      // Many sites may come first at once.
      if (auto locked = sql_->be_alone(); !locked) return locked;
      const auto since = sql_->version();
      if (!since) return tl::unexpected{since.error()};
      if (*since == kVersion) return {};
      for (const char* table : kTables)
        if (auto made = run(fmt::format(fmt::runtime(table), sql_->numbered()), {}); !made)
          return tl::unexpected{made.error()};
      return done(run("INSERT INTO fleet_version (version) VALUES (?)", {kVersion}));
    });
  }

  Result<void> announce(const fleet::Fab& fab, std::span<const fleet::Machine> machines) override {
    return together([&]() -> Result<void> {
      auto made =
          run("INSERT INTO fab (name, address, certificate, catalogue) VALUES (?, ?, ?, ?) ON CONFLICT (name) DO "
              "UPDATE SET "
              "address = excluded.address, certificate = excluded.certificate, catalogue = excluded.catalogue",
              {fab.name, fab.address, fab.certificate, fab.catalogue});
      if (!made) return tl::unexpected{made.error()};
      std::string names;
      for (const fleet::Machine& m : machines) {
        const auto placed =
            run(fmt::format(
                    "INSERT INTO machine (name, fab, profile, light, resin, width_mm, depth_mm, height_mm, pixel_mm, "
                    "calibrated_unix_ms, readiness, seen_unix_ms) VALUES (?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, {}) ON "
                    "CONFLICT (name) DO UPDATE SET profile = excluded.profile, light = excluded.light, resin = "
                    "excluded.resin, width_mm = excluded.width_mm, depth_mm = excluded.depth_mm, height_mm = "
                    "excluded.height_mm, pixel_mm = excluded.pixel_mm, calibrated_unix_ms = "
                    "excluded.calibrated_unix_ms, readiness = excluded.readiness, seen_unix_ms = "
                    "excluded.seen_unix_ms WHERE machine.fab = excluded.fab RETURNING name",
                    sql_->now()),
                {m.name, fab.name, m.profile, m.light, m.resin, m.width_mm, m.depth_mm, m.height_mm, m.pixel_mm,
                 m.calibrated_unix_ms, static_cast<std::int64_t>(m.readiness)});
        if (!placed) return tl::unexpected{placed.error()};
        if (placed->empty())
          return fail(
              ErrorCode::Conflict,
              fmt::format("a machine named {} stands in another fab of the fleet; give it another name", m.name));
      }
      std::string known;
      std::vector<SqlValue> values{fab.name};
      for (const fleet::Machine& m : machines) {
        known += known.empty() ? "?" : ", ?";
        values.emplace_back(m.name);
      }
      return done(run(fmt::format("DELETE FROM machine WHERE fab = ?{} AND NOT EXISTS (SELECT 1 FROM lease WHERE "
                                  "lease.machine = machine.name)",
                                  known.empty() ? "" : fmt::format(" AND name NOT IN ({})", known)),
                      std::move(values)));
    });
  }

  Result<std::vector<fleet::Fab>> fabs() override {
    return together([&]() -> Result<std::vector<fleet::Fab>> {
      const auto rows = run("SELECT name, address, certificate, catalogue FROM fab ORDER BY name", {});
      if (!rows) return tl::unexpected{rows.error()};
      std::vector<fleet::Fab> all;
      for (const SqlRow& row : *rows) all.push_back({row[0], row[1], row[2], row[3]});
      return all;
    });
  }

  Result<std::vector<fleet::Machine>> machines() override {
    return together([&]() -> Result<std::vector<fleet::Machine>> {
      const auto rows = run(fmt::format("SELECT {} FROM machine ORDER BY name", kMachineColumns), {});
      if (!rows) return tl::unexpected{rows.error()};
      std::vector<fleet::Machine> all;
      for (const SqlRow& row : *rows) all.push_back(machine_of(row));
      return all;
    });
  }

  Result<void> drain(std::string_view machine, bool is_draining, std::string_view who) override {
    return together([&]() -> Result<void> {
      const auto set = run("UPDATE machine SET is_draining = ? WHERE name = ? RETURNING name",
                           {std::int64_t{is_draining}, std::string{machine}});
      if (!set) return tl::unexpected{set.error()};
      if (set->empty()) return fail(ErrorCode::NotFound, fmt::format("no machine {} in the fleet", machine));
      note({}, machine, fmt::format("{} by {}", is_draining ? "taken out of service" : "back in service", who));
      return {};
    });
  }

  Result<std::vector<fleet::Job>> submit(const fleet::NewJob& job) override {
    if (job.copies < 1 || job.copies > kMostCopies)
      return fail(ErrorCode::InvalidInput, fmt::format("copies: 1 to {}", kMostCopies));
    return together([&]() -> Result<std::vector<fleet::Job>> {
      std::vector<fleet::Job> all;
      for (std::uint32_t copy = 1; copy <= job.copies; ++copy) {
        const std::string id = copy_name(job.id, copy);
        const fleet::Needs& n = job.needs;
        const auto made =
            run("INSERT INTO fleet_job (id, name, owner, site, asks_for, light, resin, width_mm, depth_mm, height_mm, "
                "pixel_mm, calibrated_within_ms, priority, deadline_unix_ms, stack_key, state) VALUES (?, ?, ?, ?, ?, "
                "?, ?, "
                "?, ?, ?, ?, ?, ?, ?, ?, ?) ON CONFLICT (id) DO NOTHING RETURNING id",
                {id, job.name, job.owner, job.site, n.machine, n.light, n.resin, n.width_mm, n.depth_mm, n.height_mm,
                 n.pixel_mm, n.calibrated_within_ms, std::int64_t{job.priority},
                 job.deadline_unix_ms > 0 ? job.deadline_unix_ms : kNever, job.stack_key, number_of(State::Waiting)});
        if (!made) return tl::unexpected{made.error()};
        auto kept = job_with(id);
        if (!kept) return tl::unexpected{kept.error()};
        if (made->empty() && !(kept->site == job.site && kept->needs == n && kept->stack_key == job.stack_key))
          return fail(ErrorCode::Conflict, fmt::format("there is another job {} in the fleet", id));
        if (!made->empty()) note(id, {}, fmt::format("submitted by {}", job.owner));
        all.push_back(std::move(*kept));
      }
      return all;
    });
  }

  Result<std::vector<fleet::Job>> jobs(std::span<const State> states, std::uint64_t after, std::size_t most) override {
    std::vector<std::int64_t> numbers;
    for (const State state : states) numbers.push_back(number_of(state));
    const std::string of_states = numbers.empty() ? "" : fmt::format("f.state IN ({}) AND ", fmt::join(numbers, ", "));
    return together([&] {
      return select(
          fmt::format("SELECT {} {} WHERE {}f.place > ? ORDER BY f.place LIMIT ?", kJobColumns, kJobs, of_states),
          {static_cast<std::int64_t>(after), static_cast<std::int64_t>(most)});
    });
  }

  Result<fleet::Job> find(std::string_view job) override {
    return together([&] { return job_with(std::string{job}); });
  }

  Result<fleet::Job> cancel(std::string_view job, std::string_view who) override {
    return together([&]() -> Result<fleet::Job> {
      const std::string id{job};
      if (auto freed = run("DELETE FROM lease WHERE job = ? AND is_bound = 0", {id}); !freed)
        return tl::unexpected{freed.error()};
      const auto ended =
          run("UPDATE fleet_job SET state = ?, message = ? WHERE id = ? AND state IN (1, 2) RETURNING id",
              {number_of(State::Cancelled), fmt::format("by {}", who), id});
      if (!ended) return tl::unexpected{ended.error()};
      auto now = job_with(id);
      if (!now) return now;
      if (ended->empty())
        return fail(ErrorCode::Conflict,
                    fleet::is_final(now->state)
                        ? fmt::format("job {} is {}", id, name_of(now->state))
                        : fmt::format("job {} is being printed by {}; cancel it at its fab", id, now->machine));
      note(id, {}, fmt::format("cancelled by {}", who));
      return now;
    });
  }

  using FleetQueue::claim;
  Result<std::optional<fleet::Lease>> claim(std::span<const std::string> machines, Nanoseconds lasts) override {
    if (machines.empty()) return std::optional<fleet::Lease>{};
    std::vector<std::string> marks(machines.size(), "?");
    const std::string among = fmt::format("{}", fmt::join(marks, ", "));
    const std::vector<SqlValue> names{machines.begin(), machines.end()};
    auto claimed = together([&]() -> Result<std::optional<fleet::Lease>> {
      const std::string fits = fmt::format(fmt::runtime(kFits), sql_->now(), fleet::kNotSeen_ms);
      const std::string is_idle = "NOT EXISTS (SELECT 1 FROM lease l WHERE l.machine = m.name)";
      // Which job, for which machine, and its next attempt, in one statement: what others look at is passed over.
      // Materialized: chosen again for every row it is held against it would be another one each time.
      const auto found =
          run(fmt::format(
                  "WITH c AS MATERIALIZED (SELECT j.id AS job, m.name AS machine FROM fleet_job j, machine m WHERE "
                  "m.name IN ({}) AND {} AND {} ORDER BY j.priority DESC, j.deadline_unix_ms, j.place, m.name LIMIT "
                  "1{}) UPDATE fleet_job SET state = 2, attempt = fleet_job.attempt + 1, machine = c.machine, "
                  "message = '' FROM c WHERE fleet_job.id = c.job AND fleet_job.state = 1 RETURNING id, attempt, "
                  "fleet_job.machine",
                  among, is_idle, fits, sql_->skipping_locked()),
              names);
      if (!found) return tl::unexpected{found.error()};
      if (found->empty()) {
        const auto idle =
            run(fmt::format("SELECT COUNT(*) FROM machine m WHERE m.name IN ({}) AND {}", among, is_idle), names);
        if (!idle) return tl::unexpected{idle.error()};
        if (idle->front().front() == "0") return fail(ErrorCode::Conflict, "");
        return std::optional<fleet::Lease>{};
      }
      Columns c{found->front()};
      fleet::Lease lease;
      lease.job = c.text();
      lease.attempt = static_cast<std::uint32_t>(c.number());
      lease.machine = c.text();
      lease.left_ms = ms_of(lasts);
      // A machine has one lease: its key says so.
      auto given = run(
          fmt::format("INSERT INTO lease (job, machine, attempt, until_unix_ms) VALUES (?, ?, ?, {} + ?)", sql_->now()),
          {lease.job, lease.machine, std::int64_t{lease.attempt}, lease.left_ms});
      if (!given) return tl::unexpected{given.error()};
      note(lease.job, lease.machine, fmt::format("attempt {}", lease.attempt));
      return std::optional{lease};
    });
    if (!claimed && claimed.error().code == ErrorCode::Conflict)
      return fail(ErrorCode::Conflict, machines.size() == 1
                                           ? fmt::format("machine {} has a job of the fleet already", machines.front())
                                           : "each of the machines has a job of the fleet already");
    return claimed;
  }

  Result<std::optional<fleet::Lease>> renew(std::string_view job, std::uint32_t attempt, Nanoseconds lasts) override {
    return together([&]() -> Result<std::optional<fleet::Lease>> {
      // One that ran out and that nobody has taken yet goes on.
      const auto renewed =
          run(fmt::format(
                  "UPDATE lease SET until_unix_ms = {} + ? WHERE job = ? AND attempt = ? RETURNING machine, is_bound",
                  sql_->now()),
              {ms_of(lasts), std::string{job}, std::int64_t{attempt}});
      if (!renewed) return tl::unexpected{renewed.error()};
      if (renewed->empty()) return std::optional<fleet::Lease>{};
      Columns c{renewed->front()};
      fleet::Lease lease{std::string{job}, c.text(), attempt, ms_of(lasts), false};
      lease.is_bound = c.number() != 0;
      if (lease.is_bound)  // heard of again
        if (auto bound = run("UPDATE fleet_job SET state = 3, message = '' WHERE id = ? AND state = 4", {lease.job});
            !bound)
          return tl::unexpected{bound.error()};
      return std::optional{lease};
    });
  }

  Result<bool> bind(std::string_view job, std::uint32_t attempt) override {
    return together([&]() -> Result<bool> {
      const auto bound = run("UPDATE lease SET is_bound = 1 WHERE job = ? AND attempt = ? RETURNING machine",
                             {std::string{job}, std::int64_t{attempt}});
      if (!bound) return tl::unexpected{bound.error()};
      if (bound->empty()) return false;
      const auto moved =
          run("UPDATE fleet_job SET state = 3 WHERE id = ? AND attempt = ? AND state IN (2, 3) RETURNING id",
              {std::string{job}, std::int64_t{attempt}});
      if (!moved) return tl::unexpected{moved.error()};
      if (moved->empty()) return fail(ErrorCode::Internal, fmt::format("job {} has a lease and no machine", job));
      return true;
    });
  }

  Result<bool> release(std::string_view job, std::uint32_t attempt, std::string_view why) override {
    return together([&]() -> Result<bool> {
      const auto freed = run("DELETE FROM lease WHERE job = ? AND attempt = ? AND is_bound = 0 RETURNING machine",
                             {std::string{job}, std::int64_t{attempt}});
      if (!freed) return tl::unexpected{freed.error()};
      if (freed->empty()) return false;
      if (auto waits = wait_again(std::string{job}, why); !waits) return tl::unexpected{waits.error()};
      return true;
    });
  }

  Result<bool> finish(std::string_view job, std::uint32_t attempt, State state, std::string_view message) override {
    if (!fleet::is_final(state)) return fail(ErrorCode::InvalidInput, "a job finishes done, failed or cancelled");
    return together([&]() -> Result<bool> {
      const std::string id{job};
      const auto freed =
          run("DELETE FROM lease WHERE job = ? AND attempt = ? RETURNING machine", {id, std::int64_t{attempt}});
      if (!freed) return tl::unexpected{freed.error()};
      if (freed->empty()) {
        // Told again, because the answer was lost.
        const auto now = job_with(id);
        if (!now) return tl::unexpected{now.error()};
        return now->attempt == attempt && now->state == state;
      }
      if (auto ended = run("UPDATE fleet_job SET state = ?, message = ? WHERE id = ?",
                           {number_of(state), std::string{message}, id});
          !ended)
        return tl::unexpected{ended.error()};
      note(id, freed->front().front(), std::string{name_of(state)});
      return true;
    });
  }

  Result<std::vector<fleet::Lease>> leases_of(std::string_view machine) override {
    return together([&]() -> Result<std::vector<fleet::Lease>> {
      const auto rows =
          run(fmt::format("SELECT job, machine, attempt, until_unix_ms - {}, is_bound FROM lease WHERE machine = ?",
                          sql_->now()),
              {std::string{machine}});
      if (!rows) return tl::unexpected{rows.error()};
      std::vector<fleet::Lease> all;
      for (const SqlRow& row : *rows) {
        Columns c{row};
        fleet::Lease& lease = all.emplace_back();
        lease.job = c.text(), lease.machine = c.text();
        lease.attempt = static_cast<std::uint32_t>(c.number());
        lease.left_ms = c.number();
        lease.is_bound = c.number() != 0;
      }
      return all;
    });
  }

  Result<std::size_t> expire() override {
    return together([&]() -> Result<std::size_t> {
      const auto freed = run(
          fmt::format("DELETE FROM lease WHERE is_bound = 0 AND until_unix_ms < {} RETURNING job", sql_->now()), {});
      if (!freed) return tl::unexpected{freed.error()};
      for (const SqlRow& row : *freed)
        if (auto waits = wait_again(row[0], "its fab was not heard of"); !waits) return tl::unexpected{waits.error()};
      // Locked, and judged as it is then: a lease that is being renewed has not run out.
      const auto silent = run(fmt::format("UPDATE lease SET until_unix_ms = until_unix_ms WHERE is_bound = 1 AND "
                                          "until_unix_ms < {} RETURNING job, machine",
                                          sql_->now()),
                              {});
      if (!silent) return tl::unexpected{silent.error()};
      std::size_t asking = 0;
      for (const SqlRow& row : *silent) {
        const auto asks =
            run("UPDATE fleet_job SET state = 4, message = 'its fab is not heard of: look at the machine, then decide' "
                "WHERE "
                "id = ? AND state = 3 RETURNING id",
                {row[0]});
        if (!asks) return tl::unexpected{asks.error()};
        if (asks->empty()) continue;
        ++asking;
        note(row[0], row[1], "its fab is not heard of");
      }
      return freed->size() + asking;
    });
  }

  Result<fleet::Job> decide(std::string_view job, State state, std::string_view who) override {
    if (state != State::Waiting && state != State::Done && state != State::Failed)
      return fail(ErrorCode::InvalidInput, "decided is: waiting, done or failed");
    return together([&]() -> Result<fleet::Job> {
      const std::string id{job};
      // Its fab may be heard of again just now: then nothing is to be decided.
      const auto freed = run(
          fmt::format("DELETE FROM lease WHERE job = ? AND until_unix_ms < {} AND EXISTS (SELECT 1 FROM fleet_job f "
                      "WHERE f.id = lease.job AND f.state = 4) RETURNING machine",
                      sql_->now()),
          {id});
      if (!freed) return tl::unexpected{freed.error()};
      const auto decided = run(
          "UPDATE fleet_job SET state = ?, message = ? WHERE id = ? AND state = 4 AND NOT EXISTS (SELECT 1 FROM lease "
          "WHERE lease.job = fleet_job.id) RETURNING id",
          {number_of(state), fmt::format("decided by {}", who), id});
      if (!decided) return tl::unexpected{decided.error()};
      auto now = job_with(id);
      if (!now) return now;
      if (decided->empty())
        return fail(ErrorCode::Conflict,
                    fmt::format("nothing is to be decided about job {}: it is {}", id, name_of(now->state)));
      note(id, {}, fmt::format("{} decided {}", who, name_of(state)));
      return now;
    });
  }

  Result<void> add_event(std::string_view key, const fleet::Event& event) override {
    return together([&]() -> Result<void> {
      if (auto locked = sql_->be_alone(); !locked) return locked;
      return done(
          run(fmt::format("INSERT INTO fleet_event (key, unix_ms, job, machine, text) VALUES (?, {}, ?, ?, ?) ON "
                          "CONFLICT (key) DO NOTHING",
                          sql_->now()),
              {std::string{key}, event.job, event.machine, event.text}));
    });
  }

  Result<std::vector<fleet::Event>> events(std::uint64_t after, std::size_t most) override {
    return together([&] {
      return select_events("number > ? ORDER BY number",
                           {static_cast<std::int64_t>(after), static_cast<std::int64_t>(most)});
    });
  }

  Result<std::vector<fleet::Event>> newest_events(std::size_t most) override {
    return together([&]() -> Result<std::vector<fleet::Event>> {
      auto newest = select_events("number > 0 ORDER BY number DESC", {static_cast<std::int64_t>(most)});
      if (newest) std::reverse(newest->begin(), newest->end());
      return newest;
    });
  }

  Result<bool> wait(Nanoseconds longest) override { return sql_->wait(longest); }

  Result<std::int64_t> now_unix_ms() override {
    return together([&]() -> Result<std::int64_t> {
      const auto row = run(fmt::format("SELECT {}", sql_->now()), {});
      if (!row) return tl::unexpected{row.error()};
      return Columns{row->front()}.number();
    });
  }

 private:
  Result<std::vector<SqlRow>> run(const std::string& text, std::vector<SqlValue> values) {
    return sql_->run(text, std::move(values));
  }
  static Result<void> done(const Result<std::vector<SqlRow>>& ran) {
    if (!ran) return tl::unexpected{ran.error()};
    return {};
  }

  /// One transaction: all of it, or none. One that had to give way to another is tried again.
  template <class Work>
  auto together(const Work& work) -> decltype(work()) {
    constexpr int kTries = 5;
    for (int tries = 1;; ++tries) {
      auto outcome = once(work);
      if (outcome || outcome.error().code != kGaveWay) return outcome;
      if (tries == kTries) return fail(ErrorCode::StorageFailed, outcome.error().what);
    }
  }
  template <class Work>
  auto once(const Work& work) -> decltype(work()) {
    notes_.clear();
    if (auto begun = sql_->begin(); !begun) return tl::unexpected{begun.error()};
    auto outcome = work();
    if (outcome)
      if (auto written = write_notes(); !written) outcome = tl::unexpected{written.error()};
    if (!outcome) {
      sql_->roll_back();
      return outcome;
    }
    if (auto kept = sql_->commit(); !kept) {
      sql_->roll_back();
      return tl::unexpected{kept.error()};
    }
    return outcome;
  }

  Result<std::vector<fleet::Job>> select(const std::string& text, std::vector<SqlValue> values) {
    const auto rows = run(text, std::move(values));
    if (!rows) return tl::unexpected{rows.error()};
    std::vector<fleet::Job> all;
    for (const SqlRow& row : *rows) all.push_back(job_of(row));
    return all;
  }

  Result<std::vector<fleet::Event>> select_events(const char* which, std::vector<SqlValue> values) {
    const auto rows =
        run(fmt::format("SELECT number, unix_ms, job, machine, text FROM fleet_event WHERE {} LIMIT ?", which),
            std::move(values));
    if (!rows) return tl::unexpected{rows.error()};
    std::vector<fleet::Event> all;
    for (const SqlRow& row : *rows) {
      Columns c{row};
      fleet::Event& event = all.emplace_back();
      event.number = static_cast<std::uint64_t>(c.number());
      event.unix_ms = c.number();
      event.job = c.text(), event.machine = c.text(), event.text = c.text();
    }
    return all;
  }

  Result<fleet::Job> job_with(const std::string& id) {
    auto found = select(fmt::format("SELECT {} {} WHERE f.id = ?", kJobColumns, kJobs), {id});
    if (!found) return tl::unexpected{found.error()};
    if (found->empty()) return fail(ErrorCode::NotFound, fmt::format("no job {} in the fleet", id));
    return std::move(found->front());
  }

  Result<void> wait_again(const std::string& job, std::string_view why) {
    if (auto waits =
            run("UPDATE fleet_job SET state = 1, message = ? WHERE id = ? AND state = 2", {std::string{why}, job});
        !waits)
      return tl::unexpected{waits.error()};
    note(job, {}, fmt::format("waits again: {}", why));
    return {};
  }

  /// An event of the queue's own, written with what it is about.
  void note(std::string_view job, std::string_view machine, std::string text) {
    notes_.push_back({0, 0, std::string{job}, std::string{machine}, std::move(text)});
  }
  /// Events are numbered in the order in which they can be read: whoever has seen number N missed none before it. So
  /// nobody else writes one until this transaction ends, and they come last in it.
  Result<void> write_notes() {
    if (notes_.empty()) return {};
    if (auto locked = sql_->be_alone(); !locked) return locked;
    for (const fleet::Event& event : notes_)
      if (auto written = run(
              fmt::format("INSERT INTO fleet_event (unix_ms, job, machine, text) VALUES ({}, ?, ?, ?)", sql_->now()),
              {event.job, event.machine, event.text});
          !written)
        return tl::unexpected{written.error()};
    return {};
  }

  std::unique_ptr<FleetSql> sql_;
  std::vector<fleet::Event> notes_;  ///< of the transaction under way
};

Result<std::unique_ptr<FleetQueue>> prepared(std::unique_ptr<FleetSql> sql) {
  auto queue = std::make_unique<SqlFleetQueue>(std::move(sql));
  if (auto ready = queue->prepare(); !ready) return tl::unexpected{ready.error()};
  return queue;
}

}  // namespace

Result<std::unique_ptr<FleetQueue>> open_fleet_file(const std::filesystem::path& path, const Clock& clock) {
  auto sql = open_fleet_sqlite(path, clock);
  if (!sql) return tl::unexpected{sql.error()};
  return prepared(std::move(*sql));
}

Result<std::unique_ptr<FleetQueue>> open_fleet_database(const std::string& uri) {
  auto sql = open_fleet_postgres(uri);
  if (!sql) return tl::unexpected{sql.error()};
  return prepared(std::move(*sql));
}

Result<std::unique_ptr<FleetQueue>> open_fleet(const std::string& where, const Clock& clock) {
  constexpr std::string_view kFile = "sqlite:";
  if (where.starts_with(kFile) && where.size() > kFile.size())
    return open_fleet_file(where.substr(kFile.size()), clock);
  if (where.starts_with("postgresql://") || where.starts_with("postgres://")) return open_fleet_database(where);
  return fail(ErrorCode::InvalidInput,
              fmt::format("{} is not the name of a fleet: sqlite:PATH, or postgresql://USER@HOST/DATABASE", where));
}

}  // namespace telefab
