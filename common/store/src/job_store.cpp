// SPDX-License-Identifier: GPL-3.0-or-later
#include <fmt/format.h>
#include <sqlite3.h>

#include <atomic>
#include <mutex>
#include <telefab/store/job_store.hpp>

namespace telefab {
namespace {

constexpr int kSchemaVersion = 2;
constexpr int kApplicationId = 0x54464142;  // "TFAB"

constexpr const char* kSchema = R"sql(
CREATE TABLE job (
  id              TEXT PRIMARY KEY,
  place           BIGINT NOT NULL,
  name            TEXT NOT NULL,
  machine         TEXT NOT NULL,
  parameters      TEXT NOT NULL,
  owner           TEXT NOT NULL,
  state           INTEGER NOT NULL,
  message         TEXT NOT NULL,
  layers          BIGINT NOT NULL DEFAULT 0,
  layers_sliced   BIGINT NOT NULL DEFAULT 0,
  layers_sent     BIGINT NOT NULL DEFAULT 0,
  print_layers    BIGINT NOT NULL DEFAULT 0,
  layers_planned  BIGINT NOT NULL DEFAULT 0,
  layers_printed  BIGINT NOT NULL DEFAULT 0,
  scan_bytes      BIGINT NOT NULL DEFAULT 0,
  wire_bytes      BIGINT NOT NULL DEFAULT 0,
  created_unix_ms BIGINT NOT NULL,
  changed_unix_ms BIGINT NOT NULL);
CREATE TABLE job_stage (job_id TEXT NOT NULL, place BIGINT NOT NULL, stage TEXT NOT NULL, seconds DOUBLE PRECISION NOT NULL, PRIMARY KEY (job_id, stage));
CREATE TABLE job_event (number BIGINT PRIMARY KEY, job_id TEXT NOT NULL, unix_ms BIGINT NOT NULL, text TEXT NOT NULL);
CREATE INDEX job_event_of_job ON job_event (job_id, number);
)sql";

/// Version 1 had no state for what waits for approval: it was ready, with a message that said so.
constexpr const char* kFromVersion1 = "UPDATE job SET state = 11 WHERE state = 5 AND message <> '';";

constexpr const char* kColumns =
    "id, name, machine, parameters, owner, state, message, layers, layers_sliced, layers_sent, print_layers, "
    "layers_planned, "
    "layers_printed, scan_bytes, wire_bytes, created_unix_ms, changed_unix_ms";

struct CloseDatabase {
  void operator()(sqlite3* database) const { sqlite3_close_v2(database); }
};
struct FinalizeStatement {
  void operator()(sqlite3_stmt* statement) const { sqlite3_finalize(statement); }
};

/// One prepared statement; binds in order, steps, reads columns in order.
class Statement {
 public:
  Statement(sqlite3* database, const std::string& text) : database_{database} {
    sqlite3_stmt* raw = nullptr;
    code_ = sqlite3_prepare_v2(database, text.c_str(), -1, &raw, nullptr);
    statement_.reset(raw);
  }
  Statement& bind(std::string_view text) {
    // A null pointer would bind NULL, not the empty text.
    if (code_ == SQLITE_OK)
      code_ = sqlite3_bind_text64(statement_.get(), ++bound_, text.data() ? text.data() : "", text.size(),
                                  SQLITE_TRANSIENT, SQLITE_UTF8);
    return *this;
  }
  Statement& bind(std::int64_t number) {
    if (code_ == SQLITE_OK) code_ = sqlite3_bind_int64(statement_.get(), ++bound_, number);
    return *this;
  }
  Statement& bind(double number) {
    if (code_ == SQLITE_OK) code_ = sqlite3_bind_double(statement_.get(), ++bound_, number);
    return *this;
  }
  /// True for a row, false for the end; an Error with SQLite's reason otherwise.
  [[nodiscard]] Result<bool> step() {
    if (code_ == SQLITE_OK) code_ = sqlite3_step(statement_.get());
    const int code = std::exchange(code_, SQLITE_OK);
    read_ = 0;
    if (code == SQLITE_ROW) return true;
    if (code == SQLITE_DONE) return false;
    return fail(ErrorCode::StorageFailed,
                fmt::format("job store {}: {}", sqlite3_db_filename(database_, "main"), sqlite3_errmsg(database_)));
  }
  [[nodiscard]] std::string text() {
    const auto* bytes = sqlite3_column_text(statement_.get(), read_);
    const int size = sqlite3_column_bytes(statement_.get(), read_++);
    return bytes ? std::string{reinterpret_cast<const char*>(bytes), static_cast<std::size_t>(size)} : std::string{};
  }
  [[nodiscard]] std::int64_t number() { return sqlite3_column_int64(statement_.get(), read_++); }
  [[nodiscard]] double real() { return sqlite3_column_double(statement_.get(), read_++); }

 private:
  sqlite3* database_;
  std::unique_ptr<sqlite3_stmt, FinalizeStatement> statement_;
  int code_ = SQLITE_OK;
  int bound_ = 0;
  int read_ = 0;
};

}  // namespace

struct JobStore::Impl {
  std::filesystem::path path;
  const Clock& clock;
  std::unique_ptr<sqlite3, CloseDatabase> database;
  mutable std::recursive_mutex mutex;
  std::atomic<std::uint64_t> revision{1};
  std::optional<Error> trouble;

  Impl(std::filesystem::path where, const Clock& ticking) : path{std::move(where)}, clock{ticking} {}

  [[nodiscard]] std::int64_t now_unix_ms() const {
    return std::chrono::duration_cast<std::chrono::milliseconds>(clock.wall()).count();
  }

  [[nodiscard]] Statement prepare(const std::string& text) const { return Statement{database.get(), text}; }

  [[nodiscard]] Result<void> run(const std::string& text) const {
    char* reason = nullptr;
    if (sqlite3_exec(database.get(), text.c_str(), nullptr, nullptr, &reason) == SQLITE_OK) return {};
    auto error =
        fail(ErrorCode::StorageFailed, fmt::format("job store {}: {}", path.string(), reason ? reason : "unknown"));
    sqlite3_free(reason);
    return error;
  }

  /// Runs `work` in one transaction: all of it is on disk, or none.
  template <class Work>
  [[nodiscard]] auto together(const Work& work) -> decltype(work()) {
    const std::lock_guard lock{mutex};
    const auto remember = [this](const Error& error) {
      if (error.code == ErrorCode::StorageFailed) trouble = error;
      return tl::unexpected{error};
    };
    if (auto begun = run("BEGIN IMMEDIATE"); !begun) return remember(begun.error());
    auto outcome = work();
    if (!outcome) {
      (void)run("ROLLBACK");  // the first error is the one to tell
      return remember(outcome.error());
    }
    if (auto done = run("COMMIT"); !done) {
      (void)run("ROLLBACK");
      return remember(done.error());
    }
    trouble.reset();
    ++revision;
    return outcome;
  }

  [[nodiscard]] Result<void> execute(Statement statement) const {
    if (auto stepped = statement.step(); !stepped) return tl::unexpected{stepped.error()};
    return {};
  }

  [[nodiscard]] Result<std::vector<StageSeconds>> stages_of(std::string_view id) const {
    Statement query = prepare("SELECT stage, seconds FROM job_stage WHERE job_id = ? ORDER BY place");
    query.bind(id);
    std::vector<StageSeconds> stages;
    while (true) {
      auto row = query.step();
      if (!row) return tl::unexpected{row.error()};
      if (!*row) return stages;
      const auto stage = job_stage_from_name(query.text());
      if (!stage) return fail_in(fmt::format("job store {}, job {}", path.string(), id), stage.error());
      stages.push_back({*stage, query.real()});
    }
  }

  [[nodiscard]] Result<std::vector<Job>> select(Statement query) const {
    std::vector<Job> jobs;
    while (true) {
      auto row = query.step();
      if (!row) return tl::unexpected{row.error()};
      if (!*row) break;
      Job job;
      job.id = query.text();
      job.name = query.text();
      job.machine = query.text();
      job.parameters = query.text();
      job.owner = query.text();
      job.state = static_cast<JobState>(query.number());
      job.message = query.text();
      for (std::uint32_t* count :
           {&job.counters.layers, &job.counters.layers_sliced, &job.counters.layers_sent, &job.counters.print_layers,
            &job.counters.layers_planned, &job.counters.layers_printed})
        *count = static_cast<std::uint32_t>(query.number());
      job.counters.scan_bytes = static_cast<std::uint64_t>(query.number());
      job.counters.wire_bytes = static_cast<std::uint64_t>(query.number());
      job.created_unix_ms = query.number();
      job.changed_unix_ms = query.number();
      jobs.push_back(std::move(job));
    }
    for (Job& job : jobs) {
      auto stages = stages_of(job.id);
      if (!stages) return tl::unexpected{stages.error()};
      job.stages = std::move(*stages);
    }
    return jobs;
  }

  [[nodiscard]] Result<Job> find(std::string_view id) const {
    Statement query = prepare(fmt::format("SELECT {} FROM job WHERE id = ?", kColumns));
    query.bind(id);
    auto jobs = select(std::move(query));
    if (!jobs) return tl::unexpected{jobs.error()};
    if (jobs->empty()) return fail(ErrorCode::NotFound, fmt::format("no job {}", id));
    return std::move(jobs->front());
  }

  [[nodiscard]] Result<void> add_event(std::string_view id, std::string_view text) const {
    return execute(std::move(prepare("INSERT INTO job_event (number, job_id, unix_ms, text) SELECT "
                                     "COALESCE(MAX(number), 0) + 1, ?, ?, ? FROM job_event")
                                 .bind(id)
                                 .bind(now_unix_ms())
                                 .bind(text)));
  }
};

JobStore::JobStore(std::unique_ptr<Impl> impl) : impl_{std::move(impl)} {}
JobStore::~JobStore() = default;

Result<std::unique_ptr<JobStore>> JobStore::open(const std::filesystem::path& path, const Clock& clock) {
  auto impl = std::make_unique<Impl>(path, clock);
  sqlite3* raw = nullptr;
  const int code =
      sqlite3_open_v2(path.c_str(), &raw, SQLITE_OPEN_READWRITE | SQLITE_OPEN_CREATE | SQLITE_OPEN_FULLMUTEX, nullptr);
  impl->database.reset(raw);
  if (code != SQLITE_OK)
    return fail(ErrorCode::StorageFailed,
                fmt::format("cannot open job store {}: {}", path.string(), sqlite3_errstr(code)));
  sqlite3_busy_timeout(raw, 5000);

  const auto pragma = [&](const char* text) -> Result<std::int64_t> {
    Statement query = impl->prepare(text);
    auto row = query.step();
    if (!row) return tl::unexpected{row.error()};
    return *row ? query.number() : 0;
  };
  for (const char* setting : {"PRAGMA journal_mode = WAL", "PRAGMA synchronous = FULL"})
    if (auto done = impl->run(setting); !done) return tl::unexpected{done.error()};
  const auto application = pragma("PRAGMA application_id");
  if (!application) return tl::unexpected{application.error()};
  const auto version = pragma("PRAGMA user_version");
  if (!version) return tl::unexpected{version.error()};
  if (*application == 0 && *version == 0) {
    auto made = impl->together([&]() -> Result<void> {
      return impl->run(fmt::format("{} PRAGMA application_id = {}; PRAGMA user_version = {};", kSchema, kApplicationId,
                                   kSchemaVersion));
    });
    if (!made) return tl::unexpected{made.error()};
  } else if (*application == kApplicationId && *version == 1) {
    auto migrated = impl->together([&]() -> Result<void> {
      return impl->run(fmt::format("{} PRAGMA user_version = {};", kFromVersion1, kSchemaVersion));
    });
    if (!migrated) return tl::unexpected{migrated.error()};
  } else if (*application != kApplicationId || *version != kSchemaVersion) {
    return fail(
        ErrorCode::InvalidInput,
        fmt::format(
            "job store {} belongs to another program or another version of Telefab (schema {}, this one has {}); "
            "name another data folder",
            path.string(), *version, kSchemaVersion));
  }
  return std::unique_ptr<JobStore>{new JobStore{std::move(impl)}};
}

Result<Job> JobStore::create(const NewJob& job) {
  return impl_->together([&]() -> Result<Job> {
    Statement next = impl_->prepare("SELECT COALESCE(MAX(place), 0) + 1 FROM job");
    auto row = next.step();
    if (!row) return tl::unexpected{row.error()};
    const std::int64_t place = next.number();
    const std::int64_t now = impl_->now_unix_ms();
    // Readable, sortable, unique at this site: the millisecond it was made and its place.
    const std::string id = job.id ? *job.id : fmt::format("j{:x}-{}", now, place);
    if (impl_->find(id)) return fail(ErrorCode::Conflict, fmt::format("there is a job {} already", id));
    auto inserted = impl_->execute(std::move(
        impl_
            ->prepare("INSERT INTO job (id, place, name, machine, parameters, owner, state, message, created_unix_ms, "
                      "changed_unix_ms) VALUES (?, ?, ?, ?, ?, ?, ?, ?, ?, ?)")
            .bind(id)
            .bind(place)
            .bind(job.name)
            .bind(job.machine)
            .bind(job.parameters)
            .bind(job.owner)
            .bind(static_cast<std::int64_t>(JobState::Queued))
            .bind(std::string_view{})
            .bind(now)
            .bind(now)));
    if (!inserted) return tl::unexpected{inserted.error()};
    if (auto noted = impl_->add_event(id, "queued"); !noted) return tl::unexpected{noted.error()};
    return impl_->find(id);
  });
}

Result<Job> JobStore::find(std::string_view id) const {
  const std::lock_guard lock{impl_->mutex};
  return impl_->find(id);
}

Result<std::vector<Job>> JobStore::list(std::size_t most) const {
  const std::lock_guard lock{impl_->mutex};
  Statement query = impl_->prepare(fmt::format("SELECT {} FROM job ORDER BY place DESC LIMIT ?", kColumns));
  query.bind(static_cast<std::int64_t>(most));
  return impl_->select(std::move(query));
}

Result<std::vector<Job>> JobStore::unfinished() const {
  const std::lock_guard lock{impl_->mutex};
  Statement query =
      impl_->prepare(fmt::format("SELECT {} FROM job WHERE state NOT IN (?, ?, ?) ORDER BY place", kColumns));
  for (const JobState state : {JobState::Done, JobState::Failed, JobState::Cancelled})
    query.bind(static_cast<std::int64_t>(state));
  return impl_->select(std::move(query));
}

Result<Job> JobStore::move(std::string_view id, JobState to, std::string_view message) {
  return impl_->together([&]() -> Result<Job> {
    auto job = impl_->find(id);
    if (!job) return job;
    if (job->state != to && !may_follow(job->state, to))
      return fail(ErrorCode::Conflict,
                  fmt::format("job {} is {} and cannot become {}", id, name_of(job->state), name_of(to)));
    auto updated = impl_->execute(
        std::move(impl_->prepare("UPDATE job SET state = ?, message = ?, changed_unix_ms = ? WHERE id = ?")
                      .bind(static_cast<std::int64_t>(to))
                      .bind(message)
                      .bind(impl_->now_unix_ms())
                      .bind(id)));
    if (!updated) return tl::unexpected{updated.error()};
    const std::string text = message.empty() ? std::string{name_of(to)} : fmt::format("{}: {}", name_of(to), message);
    if (auto noted = impl_->add_event(id, text); !noted) return tl::unexpected{noted.error()};
    return impl_->find(id);
  });
}

Result<void> JobStore::set_counters(std::string_view id, const JobCounters& c) {
  return impl_->together([&]() -> Result<void> {
    if (auto job = impl_->find(id); !job) return tl::unexpected{job.error()};
    return impl_->execute(std::move(
        impl_
            ->prepare(
                "UPDATE job SET layers = ?, layers_sliced = ?, layers_sent = ?, print_layers = ?, layers_planned = ?, "
                "layers_printed = ?, scan_bytes = ?, wire_bytes = ?, changed_unix_ms = ? WHERE id = ?")
            .bind(std::int64_t{c.layers})
            .bind(std::int64_t{c.layers_sliced})
            .bind(std::int64_t{c.layers_sent})
            .bind(std::int64_t{c.print_layers})
            .bind(std::int64_t{c.layers_planned})
            .bind(std::int64_t{c.layers_printed})
            .bind(static_cast<std::int64_t>(c.scan_bytes))
            .bind(static_cast<std::int64_t>(c.wire_bytes))
            .bind(impl_->now_unix_ms())
            .bind(id)));
  });
}

Result<void> JobStore::set_stage_seconds(std::string_view id, JobStage stage, double seconds) {
  return impl_->together([&]() -> Result<void> {
    if (auto job = impl_->find(id); !job) return tl::unexpected{job.error()};
    return impl_->execute(
        std::move(impl_
                      ->prepare("INSERT INTO job_stage (job_id, place, stage, seconds) SELECT ?, COUNT(*), ?, ? FROM "
                                "job_stage WHERE job_id = ? "
                                "ON CONFLICT (job_id, stage) DO UPDATE SET seconds = excluded.seconds")
                      .bind(id)
                      .bind(name_of(stage))
                      .bind(seconds)
                      .bind(id)));
  });
}

Result<void> JobStore::add_event(std::string_view id, std::string_view text) {
  return impl_->together([&]() -> Result<void> {
    if (auto job = impl_->find(id); !job) return tl::unexpected{job.error()};
    return impl_->add_event(id, text);
  });
}

Result<std::vector<JobEvent>> JobStore::events(std::string_view id, std::uint64_t after, std::size_t most) const {
  const std::lock_guard lock{impl_->mutex};
  Statement query = impl_->prepare(
      "SELECT number, unix_ms, text FROM job_event WHERE job_id = ? AND number > ? ORDER BY number LIMIT ?");
  query.bind(id).bind(static_cast<std::int64_t>(after)).bind(static_cast<std::int64_t>(most));
  std::vector<JobEvent> events;
  while (true) {
    auto row = query.step();
    if (!row) return tl::unexpected{row.error()};
    if (!*row) return events;
    JobEvent event;
    event.number = static_cast<std::uint64_t>(query.number());
    event.unix_ms = query.number();
    event.text = query.text();
    events.push_back(std::move(event));
  }
}

Result<void> JobStore::health() const {
  const std::lock_guard lock{impl_->mutex};
  if (impl_->trouble) return tl::unexpected{*impl_->trouble};
  return {};
}

std::uint64_t JobStore::revision() const { return impl_->revision; }

}  // namespace telefab
