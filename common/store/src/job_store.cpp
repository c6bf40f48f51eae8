// SPDX-License-Identifier: GPL-3.0-or-later
#include <fmt/format.h>
#include <sqlite3.h>

#include <atomic>
#include <cerrno>
#include <iterator>
#include <mutex>
#include <telefab/base/damaged_file.hpp>
#include <telefab/base/file.hpp>
#include <telefab/store/job_store.hpp>

namespace telefab {
namespace {

constexpr int kSchemaVersion = 4;
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
  changed_unix_ms BIGINT NOT NULL,
  instance        TEXT NOT NULL DEFAULT '');
CREATE TABLE job_stage (job_id TEXT NOT NULL, place BIGINT NOT NULL, stage TEXT NOT NULL, seconds DOUBLE PRECISION NOT NULL, PRIMARY KEY (job_id, stage));
CREATE TABLE job_event (number BIGINT PRIMARY KEY, job_id TEXT NOT NULL, unix_ms BIGINT NOT NULL, text TEXT NOT NULL);
CREATE INDEX job_event_of_job ON job_event (job_id, number);
CREATE TABLE job_forgotten (id TEXT PRIMARY KEY, state INTEGER NOT NULL, unix_ms BIGINT NOT NULL);
)sql";

/// From each version to the next, the first from 1.
constexpr const char* kMigrations[] = {
    // There was no state for what waits for approval: it was ready, with a message that said so.
    "UPDATE job SET state = 11 WHERE state = 5 AND message <> '';",
    "CREATE TABLE IF NOT EXISTS job_forgotten (id TEXT PRIMARY KEY, state INTEGER NOT NULL, unix_ms BIGINT NOT NULL);",
    "ALTER TABLE job ADD COLUMN instance TEXT NOT NULL DEFAULT '';",
};
static_assert(std::size(kMigrations) == kSchemaVersion - 1, "each version says how it comes out of the one before");

constexpr const char* kColumns =
    "id, name, machine, parameters, owner, state, message, layers, layers_sliced, layers_sent, print_layers, "
    "layers_planned, "
    "layers_printed, scan_bytes, wire_bytes, created_unix_ms, changed_unix_ms, instance";

struct CloseDatabase {
  void operator()(sqlite3* database) const { sqlite3_close_v2(database); }
};
struct FinalizeStatement {
  void operator()(sqlite3_stmt* statement) const { sqlite3_finalize(statement); }
};

/// 1 is the newest; 0 is one that is being made.
std::filesystem::path backup_of(const std::filesystem::path& store, int number) {
  return fmt::format("{}.backup-{}", store.string(), number);
}

/// A file that is read, and is not what was written.
ErrorCode code_of(int sqlite_code) {
  return (sqlite_code & 0xff) == SQLITE_CORRUPT || (sqlite_code & 0xff) == SQLITE_NOTADB ? ErrorCode::NotTrusted
                                                                                         : ErrorCode::StorageFailed;
}

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
    const char* const path = sqlite3_db_filename(database_, "main");
    // SQLite calls a full disk an I/O error where it has no room for its own side files; what the system said last it
    // keeps over answers that have nothing to do with it.
    const int kind = code & 0xff;
    const bool is_of_system = kind == SQLITE_IOERR || kind == SQLITE_CANTOPEN;
    if (kind == SQLITE_FULL || (is_of_system && sqlite3_system_errno(database_) == ENOSPC))
      return fail_system("write", path, ENOSPC);
    return fail(code_of(code), fmt::format("job store {}: {}", path, sqlite3_errmsg(database_)));
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
    const int code = sqlite3_exec(database.get(), text.c_str(), nullptr, nullptr, &reason);
    if (code == SQLITE_OK) return {};
    auto error = fail(code_of(code), fmt::format("job store {}: {}", path.string(), reason ? reason : "unknown"));
    sqlite3_free(reason);
    return error;
  }

  /// Runs `work` in one transaction: all of it is on disk, or none.
  template <class Work>
  [[nodiscard]] auto together(const Work& work) -> decltype(work()) {
    const std::lock_guard lock{mutex};
    const auto remember = [this](const Error& error) {
      if (error.code == ErrorCode::StorageFailed || error.code == ErrorCode::NotTrusted) trouble = error;
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
      job.instance = query.text();
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
    if (jobs->empty())
      return fail(ErrorCode::NotFound, fmt::format("no job {}; `telefab jobs` lists those there are", id));
    return std::move(jobs->front());
  }

  /// The first column of the first row, which is a number; 0: there is none.
  [[nodiscard]] Result<std::int64_t> number_of(const std::string& question) const {
    Statement query = prepare(question);
    auto row = query.step();
    if (!row) return tl::unexpected{row.error()};
    return *row ? query.number() : 0;
  }

  /// A copy under another name, whole or not at all.
  [[nodiscard]] Result<void> copy_to(const std::filesystem::path& copy) const {
    const auto temporary = make_temporary_beside(copy);
    if (!temporary) return tl::unexpected{temporary.error()};
    Statement vacuum = prepare("VACUUM INTO ?");  // into an empty file it may
    if (auto done = execute(std::move(vacuum.bind(temporary->string()))); !done) {
      std::error_code ignored;  // the reason is the error that is told
      std::filesystem::remove(*temporary, ignored);
      return done;
    }
    if (auto placed = put_in_place(*temporary, copy); !placed) return placed;
    std::error_code error;  // who may read the store may read its copy, and nobody else
    std::filesystem::permissions(copy, std::filesystem::status(path, error).permissions(), error);
    if (error)
      return fail(ErrorCode::StorageFailed,
                  fmt::format("cannot set the permissions of {}: {}", copy.string(), error.message()));
    return {};
  }

  [[nodiscard]] Result<void> check() const {
    Statement query = prepare("PRAGMA quick_check(1)");
    auto row = query.step();
    if (!row) return tl::unexpected{row.error()};
    const std::string found = *row ? query.text() : "it says nothing";
    if (found == "ok") return {};
    return fail(ErrorCode::NotTrusted, fmt::format("job store {} is damaged: {}", path.string(), found));
  }

  /// Step by step up to this version; the file as it was stays beside.
  [[nodiscard]] Result<void> migrate(std::int64_t from) {
    if (auto kept = copy_to(fmt::format("{}.schema-{}", path.string(), from)); !kept) return kept;
    return together([&]() -> Result<void> {
      for (std::int64_t version = from; version < kSchemaVersion; ++version)
        if (auto done = run(kMigrations[version - 1]); !done) return done;
      return run(fmt::format("PRAGMA user_version = {};", kSchemaVersion));
    });
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

  for (const char* setting : {"PRAGMA journal_mode = WAL", "PRAGMA synchronous = FULL"})
    if (auto done = impl->run(setting); !done) return tl::unexpected{done.error()};
  const auto application = impl->number_of("PRAGMA application_id");
  if (!application) return tl::unexpected{application.error()};
  const auto version = impl->number_of("PRAGMA user_version");
  if (!version) return tl::unexpected{version.error()};
  if (*application == 0 && *version == 0) {
    auto made = impl->together([&]() -> Result<void> {
      return impl->run(fmt::format("{} PRAGMA application_id = {}; PRAGMA user_version = {};", kSchema, kApplicationId,
                                   kSchemaVersion));
    });
    if (!made) return tl::unexpected{made.error()};
  } else if (*application != kApplicationId || *version < 1) {
    return fail(ErrorCode::InvalidInput,
                fmt::format("job store {} belongs to another program; name another data folder", path.string()));
  } else if (*version > kSchemaVersion) {
    return fail(ErrorCode::InvalidInput,
                fmt::format("job store {} was written by a newer version of Telefab (schema {}, this one reads up to "
                            "{}); start that version, or name another data folder",
                            path.string(), *version, kSchemaVersion));
  } else {
    if (auto checked = impl->check(); !checked) return tl::unexpected{checked.error()};
    if (*version < kSchemaVersion)
      if (auto migrated = impl->migrate(*version); !migrated) return tl::unexpected{migrated.error()};
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
    const auto before = forgotten(id);
    if (!before) return tl::unexpected{before.error()};
    if (*before)
      return fail(ErrorCode::Conflict,
                  fmt::format("there was a job {} already: it ended as {}, and was forgotten", id, name_of(**before)));
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

Result<void> JobStore::set_instance(std::string_view id, std::string_view instance) {
  return impl_->together([&]() -> Result<void> {
    const auto job = impl_->find(id);
    if (!job) return tl::unexpected{job.error()};
    if (job->instance == instance) return {};
    auto updated =
        impl_->execute(std::move(impl_->prepare("UPDATE job SET instance = ?, changed_unix_ms = ? WHERE id = ?")
                                     .bind(instance)
                                     .bind(impl_->now_unix_ms())
                                     .bind(id)));
    if (!updated) return updated;
    return impl_->add_event(id, instance.empty() ? "on no machine" : fmt::format("on machine {}", instance));
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

Result<std::vector<Job>> JobStore::ended() const {
  const std::lock_guard lock{impl_->mutex};
  Statement query = impl_->prepare(
      fmt::format("SELECT {} FROM job WHERE state IN (?, ?, ?) ORDER BY changed_unix_ms, place", kColumns));
  for (const JobState state : {JobState::Done, JobState::Failed, JobState::Cancelled})
    query.bind(static_cast<std::int64_t>(state));
  return impl_->select(std::move(query));
}

Result<Job> JobStore::forget(std::string_view id) {
  return impl_->together([&]() -> Result<Job> {
    auto job = impl_->find(id);
    if (!job) return job;
    if (!is_final(job->state))
      return fail(ErrorCode::Conflict,
                  fmt::format("job {} is {}: only a job that has ended can be forgotten", id, name_of(job->state)));
    auto kept =
        impl_->execute(std::move(impl_->prepare("INSERT INTO job_forgotten (id, state, unix_ms) VALUES (?, ?, ?)")
                                     .bind(id)
                                     .bind(static_cast<std::int64_t>(job->state))
                                     .bind(impl_->now_unix_ms())));
    if (!kept) return tl::unexpected{kept.error()};
    for (const char* statement : {"DELETE FROM job_event WHERE job_id = ?", "DELETE FROM job_stage WHERE job_id = ?",
                                  "DELETE FROM job WHERE id = ?"})
      if (auto done = impl_->execute(std::move(impl_->prepare(statement).bind(id))); !done)
        return tl::unexpected{done.error()};
    return job;
  });
}

Result<std::optional<JobState>> JobStore::forgotten(std::string_view id) const {
  const std::lock_guard lock{impl_->mutex};
  Statement query = impl_->prepare("SELECT state FROM job_forgotten WHERE id = ?");
  query.bind(id);
  auto row = query.step();
  if (!row) return tl::unexpected{row.error()};
  if (!*row) return std::optional<JobState>{};
  return std::optional{static_cast<JobState>(query.number())};
}

Result<void> JobStore::back_up() {
  const std::lock_guard lock{impl_->mutex};
  const auto backup = [&](int number) { return backup_of(impl_->path, number); };
  // The new one first: where it cannot be written, the old ones stay as they are.
  const std::filesystem::path made = backup(0);
  if (auto copied = impl_->copy_to(made); !copied) return copied;
  std::error_code error;  // one that is not there is not moved
  for (int number = kStoreBackups; number > 1; --number)
    std::filesystem::rename(backup(number - 1), backup(number), error);
  std::filesystem::rename(made, backup(1), error);
  if (error)
    return fail(ErrorCode::StorageFailed, fmt::format("cannot keep {}: {}", backup(1).string(), error.message()));
  return {};
}

Result<void> JobStore::health() const {
  const std::lock_guard lock{impl_->mutex};
  if (impl_->trouble) return tl::unexpected{*impl_->trouble};
  return {};
}

std::uint64_t JobStore::revision() const { return impl_->revision; }

namespace {

/// Gives the damaged file and what belongs to it other names; the first of them.
Result<std::filesystem::path> set_aside(const std::filesystem::path& path) {
  auto aside = name_for_damaged(path);
  if (!aside) return aside;
  std::error_code error;
  for (const char* part : {"-wal", "-shm"})
    if (!error && std::filesystem::exists(path.string() + part, error))
      std::filesystem::rename(path.string() + part, aside->string() + part, error);
  if (!error) std::filesystem::rename(path, *aside, error);
  if (!error) return aside;
  return fail(ErrorCode::StorageFailed,
              fmt::format("{} is damaged and cannot be set aside: {}", path.string(), error.message()));
}

}  // namespace

Result<RestoredStore> open_or_restore(const std::filesystem::path& path, const Clock& clock) {
  std::error_code error;
  const auto backup = [&](int number) { return backup_of(path, number); };
  std::string notice;
  // A start that ended while it restored leaves no file, and backups.
  if (!std::filesystem::exists(path, error) && std::filesystem::exists(backup(1), error)) {
    notice = fmt::format("job store {} is missing", path.string());
  } else {
    auto store = JobStore::open(path, clock);
    if (store) return RestoredStore{std::move(*store), {}};
    if (store.error().code != ErrorCode::NotTrusted) return tl::unexpected{store.error()};
    const auto aside = set_aside(path);
    if (!aside) return tl::unexpected{aside.error()};
    notice = fmt::format("{}; it is kept as {}", store.error().what, aside->string());
  }
  for (int number = 1; number <= kStoreBackups; ++number) {
    if (!std::filesystem::exists(backup(number), error)) continue;
    const auto copy = make_temporary_beside(path);
    if (!copy) return tl::unexpected{copy.error()};
    std::filesystem::copy_file(backup(number), *copy, std::filesystem::copy_options::overwrite_existing, error);
    if (error)
      return fail(ErrorCode::StorageFailed,
                  fmt::format("cannot copy {}: {}", backup(number).string(), error.message()));
    if (auto placed = put_in_place(*copy, path); !placed) return tl::unexpected{placed.error()};
    auto store = JobStore::open(path, clock);
    if (store)
      return RestoredStore{std::move(*store), fmt::format("{}; {} took its place, and changes since then are lost",
                                                          notice, backup(number).string())};
    if (store.error().code != ErrorCode::NotTrusted) return tl::unexpected{store.error()};
    for (const char* part : {"", "-wal", "-shm"}) std::filesystem::remove(path.string() + part, error);
  }
  auto store = JobStore::open(path, clock);
  if (!store) return tl::unexpected{store.error()};
  return RestoredStore{std::move(*store), notice + "; there is no sound backup, and the list begins empty"};
}

}  // namespace telefab
