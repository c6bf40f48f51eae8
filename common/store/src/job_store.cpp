// SPDX-License-Identifier: GPL-3.0-or-later
#include <telefab/store/job_store.hpp>

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <atomic>
#include <iterator>
#include <mutex>
#include <sstream>

#include "job_store_backups.hpp"
#include "sqlite_file.hpp"

namespace telefab {
namespace {

constexpr int kSchemaVersion = 5;
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
CREATE INDEX job_by_place ON job (place);
CREATE INDEX job_by_state ON job (state, place);
)sql";

/// From each version to the next, the first from 1.
constexpr const char* kMigrations[] = {
    // There was no state for what waits for approval: it was ready, with a message that said so.
    "UPDATE job SET state = 11 WHERE state = 5 AND message <> '';",
    "CREATE TABLE IF NOT EXISTS job_forgotten (id TEXT PRIMARY KEY, state INTEGER NOT NULL, unix_ms BIGINT NOT NULL);",
    "ALTER TABLE job ADD COLUMN instance TEXT NOT NULL DEFAULT '';",
    "CREATE INDEX IF NOT EXISTS job_by_place ON job (place); CREATE INDEX IF NOT EXISTS job_by_state ON job (state, "
    "place);",
};
static_assert(std::size(kMigrations) == kSchemaVersion - 1, "each version says how it comes out of the one before");

constexpr const char* kColumns =
    "id, name, machine, parameters, owner, state, message, layers, layers_sliced, layers_sent, print_layers, "
    "layers_planned, "
    "layers_printed, scan_bytes, wire_bytes, created_unix_ms, changed_unix_ms, instance";

/// Numbers of states for IN (...).
std::string list_of_states(const std::vector<JobState>& states) {
  std::string list;
  for (const JobState state : states)
    list += fmt::format("{}{}", list.empty() ? "" : ", ", static_cast<std::int64_t>(state));
  return list;
}

/// In small letters, as SQLite's lower() makes them.
std::vector<std::string> words_of(std::string_view text) {
  std::vector<std::string> words;
  std::istringstream stream{std::string{text}};
  for (std::string word; stream >> word;) {
    for (char& c : word)
      if (c >= 'A' && c <= 'Z') c = static_cast<char>(c - 'A' + 'a');
    words.push_back(std::move(word));
  }
  return words;
}

/// That a word occurs in what people know a job by; its ? is pattern_of the word.
std::string condition_of(const std::string& word) {
  std::vector<JobState> states;
  for (const JobState state : kJobStates)
    if (name_of(state).find(word) != std::string_view::npos) states.push_back(state);
  const std::string of_state = states.empty() ? "" : fmt::format(" OR state IN ({})", list_of_states(states));
  return "(lower(name || ' ' || owner || ' ' || id || ' ' || machine || ' ' || instance) LIKE ? ESCAPE '!'" + of_state +
         ")";
}

std::string pattern_of(const std::string& word) {
  std::string pattern = "%";
  for (const char c : word) {
    if (c == '%' || c == '_' || c == '!') pattern += '!';
    pattern += c;
  }
  return pattern + "%";
}

}  // namespace

struct JobStore::Impl {
  SqliteFile file;
  const Clock& clock;
  mutable std::recursive_mutex mutex;
  std::atomic<std::uint64_t> revision{1};
  std::optional<Error> trouble;

  Impl(SqliteFile opened, const Clock& ticking) : file{std::move(opened)}, clock{ticking} {}

  [[nodiscard]] std::int64_t now_unix_ms() const {
    return std::chrono::duration_cast<std::chrono::milliseconds>(clock.wall()).count();
  }

  [[nodiscard]] Statement prepare(const std::string& text) const { return file.prepare(text); }
  [[nodiscard]] Result<void> execute(Statement statement) const { return file.execute(std::move(statement)); }

  /// Runs `work` in one transaction: all of it is on disk, or none.
  template <class Work>
  [[nodiscard]] auto together(const Work& work) -> decltype(work()) {
    const std::lock_guard lock{mutex};
    const auto remember = [this](const Error& error) {
      if (error.code == ErrorCode::StorageFailed || error.code == ErrorCode::NotTrusted) trouble = error;
      return tl::unexpected{error};
    };
    if (auto begun = file.run("BEGIN IMMEDIATE"); !begun) return remember(begun.error());
    auto outcome = work();
    if (!outcome) {
      (void)file.run("ROLLBACK");  // the first error is the one to tell
      return remember(outcome.error());
    }
    if (auto done = file.run("COMMIT"); !done) {
      (void)file.run("ROLLBACK");
      return remember(done.error());
    }
    trouble.reset();
    ++revision;
    return outcome;
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
      if (!stage) return fail_in(fmt::format("job store {}, job {}", file.path().string(), id), stage.error());
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

  /// Step by step up to this version; the file as it was stays beside.
  [[nodiscard]] Result<void> migrate(std::int64_t from) {
    if (auto kept = file.copy_to(fmt::format("{}.schema-{}", file.path().string(), from)); !kept) return kept;
    return together([&]() -> Result<void> {
      for (std::int64_t version = from; version < kSchemaVersion; ++version)
        if (auto done = file.run(kMigrations[version - 1]); !done) return done;
      return file.run(fmt::format("PRAGMA user_version = {};", kSchemaVersion));
    });
  }

  [[nodiscard]] Result<void> add_event(std::string_view id, std::string_view text) const {
    return execute(std::move(prepare("INSERT INTO job_event (number, job_id, unix_ms, text) SELECT "
                                     "COALESCE(MAX(number), 0) + 1, ?, ?, ? FROM job_event")
                                 .bind(id)
                                 .bind(now_unix_ms())
                                 .bind(text)));
  }
  /// `may_be_left`: whether the job may go there from the state it is in.
  [[nodiscard]] Result<Job> move(std::string_view id, JobState to, std::string_view message,
                                 const std::function<bool(JobState from)>& may_be_left) {
    return together([&]() -> Result<Job> {
      auto job = find(id);
      if (!job) return job;
      if (!may_be_left(job->state))
        return fail(ErrorCode::Conflict,
                    fmt::format("job {} is {} and cannot become {}", id, name_of(job->state), name_of(to)));
      auto updated =
          execute(std::move(prepare("UPDATE job SET state = ?, message = ?, changed_unix_ms = ? WHERE id = ?")
                                .bind(static_cast<std::int64_t>(to))
                                .bind(message)
                                .bind(now_unix_ms())
                                .bind(id)));
      if (!updated) return tl::unexpected{updated.error()};
      const std::string text = message.empty() ? std::string{name_of(to)} : fmt::format("{}: {}", name_of(to), message);
      if (auto noted = add_event(id, text); !noted) return tl::unexpected{noted.error()};
      return find(id);
    });
  }
};

JobStore::JobStore(std::unique_ptr<Impl> impl) : impl_{std::move(impl)} {}
JobStore::~JobStore() = default;

Result<std::unique_ptr<JobStore>> JobStore::open(const std::filesystem::path& path, const Clock& clock) {
  auto file = SqliteFile::open(path, "job store");
  if (!file) return tl::unexpected{file.error()};
  auto impl = std::make_unique<Impl>(std::move(*file), clock);
  const auto application = impl->file.number_of("PRAGMA application_id");
  if (!application) return tl::unexpected{application.error()};
  const auto version = impl->file.number_of("PRAGMA user_version");
  if (!version) return tl::unexpected{version.error()};
  if (*application == 0 && *version == 0) {
    auto made = impl->together([&]() -> Result<void> {
      return impl->file.run(fmt::format("{} PRAGMA application_id = {}; PRAGMA user_version = {};", kSchema,
                                        kApplicationId, kSchemaVersion));
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
    if (auto checked = impl->file.check(); !checked) return tl::unexpected{checked.error()};
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
    const std::string id = job.id ? *job.id : fmt::format("{}j{:x}-{}", job.id_prefix, now, place);
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

Result<JobPage> JobStore::list(const JobQuery& asked) const {
  std::vector<std::string> conditions;
  if (asked.before > 0) conditions.emplace_back("place < ?");
  if (!asked.states.empty()) conditions.push_back(fmt::format("state IN ({})", list_of_states(asked.states)));
  const std::vector<std::string> words = words_of(asked.words);
  for (const std::string& word : words) conditions.push_back(condition_of(word));
  const std::lock_guard lock{impl_->mutex};
  // One more than asked for: whether there are more.
  Statement query = impl_->prepare(fmt::format("SELECT {} FROM job {} {} ORDER BY place DESC LIMIT ?", kColumns,
                                               conditions.empty() ? "" : "WHERE", fmt::join(conditions, " AND ")));
  if (asked.before > 0) query.bind(static_cast<std::int64_t>(asked.before));
  for (const std::string& word : words) query.bind(pattern_of(word));
  query.bind(std::int64_t{asked.most} + 1);
  auto found = impl_->select(std::move(query));
  if (!found) return tl::unexpected{found.error()};
  JobPage page;
  page.jobs = std::move(*found);
  if (page.jobs.size() <= asked.most) return page;
  page.jobs.resize(asked.most);
  if (page.jobs.empty()) return page;
  Statement last = impl_->prepare("SELECT place FROM job WHERE id = ?");
  const auto row = last.bind(page.jobs.back().id).step();
  if (!row) return tl::unexpected{row.error()};
  page.next = static_cast<std::uint64_t>(last.number());
  return page;
}

Result<std::vector<Job>> JobStore::current(std::size_t most) const {
  std::vector<JobState> live;
  for (const JobState state : kJobStates)
    if (!is_final(state)) live.push_back(state);
  const std::lock_guard lock{impl_->mutex};
  Statement query = impl_->prepare(
      fmt::format("SELECT {} FROM job WHERE state IN ({}) OR place >= COALESCE((SELECT place FROM job ORDER BY place "
                  "DESC LIMIT 1 OFFSET ?), 0) ORDER BY place DESC",
                  kColumns, list_of_states(live)));
  query.bind(static_cast<std::int64_t>(most == 0 ? 0 : most - 1));
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
  return impl_->move(id, to, message, [to](JobState from) { return from == to || may_follow(from, to); });
}

Result<Job> JobStore::send_again(std::string_view id, std::string_view message) {
  return impl_->move(id, JobState::Sending, message, [](JobState from) { return !is_final(from); });
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
  const auto backup = [&](int number) { return backup_of(impl_->file.path(), number); };
  // The new one first: where it cannot be written, the old ones stay as they are.
  const std::filesystem::path made = backup(0);
  if (auto copied = impl_->file.copy_to(made); !copied) return copied;
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

}  // namespace telefab
