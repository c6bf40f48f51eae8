// SPDX-License-Identifier: GPL-3.0-or-later
#include <fmt/chrono.h>
#include <fmt/format.h>

#include <algorithm>
#include <nlohmann/json.hpp>
#include <telefab/base/file.hpp>
#include <telefab/base/json_number.hpp>
#include <telefab/base/json_text.hpp>
#include <telefab/command_line/output.hpp>
#include <telefab/service/shared_verbs.hpp>
#include <telefab/store/audit_log.hpp>
#include <telefab/store/job_store.hpp>

namespace telefab {
namespace {

constexpr std::uint64_t kMaxAuditBytes = 4ULL << 30U;
constexpr std::size_t kMostEvents = 100'000;
constexpr auto kLookEvery = std::chrono::milliseconds{300};

struct LogsOptions {
  std::string job;
  std::string data;
  bool follow = false;
  bool json = false;
};

struct LogEntry {
  std::int64_t unix_ms = 0;
  std::string who;  ///< empty: the daemon itself
  std::string text;
};

void print(const LogEntry& entry, bool json) {
  if (json) {
    const nlohmann::ordered_json object{{"unix_ms", entry.unix_ms}, {"who", entry.who}, {"text", entry.text}};
    write_output(fmt::format("{}\n", json_text(object)));
  } else {
    const std::chrono::sys_time<std::chrono::milliseconds> time{std::chrono::milliseconds{entry.unix_ms}};
    write_output(fmt::format("{:%Y-%m-%d %H:%M:%S}.{:03} {}{}{}\n",
                             fmt::gmtime(std::chrono::system_clock::to_time_t(time)), entry.unix_ms % 1000, entry.who,
                             entry.who.empty() ? "" : ": ", entry.text));
  }
}

/// Lines of one part of the audit log that name the job. Its chain is checked by `audit`, not here.
Result<void> take_audit_lines(const std::filesystem::path& path, const std::string& job,
                              std::vector<LogEntry>& entries) {
  const auto bytes = read_file(path, kMaxAuditBytes);
  if (!bytes) return tl::unexpected{bytes.error()};
  std::string_view text{reinterpret_cast<const char*>(bytes->data()), bytes->size()};
  for (std::size_t end; (end = text.find('\n')) != std::string_view::npos; text.remove_prefix(end + 1)) {
    const std::string_view line = text.substr(0, end);
    if (line.find(job) == std::string_view::npos) continue;
    std::string who, what;
    std::int64_t unix_ms = 0;
    try {
      const auto entry = parsed_json(line);
      who = entry.at("who").get<std::string>();
      what = entry.at("what").get<std::string>();
      unix_ms = whole_number<std::int64_t>(entry.at("unix_ms"));
    } catch (const nlohmann::ordered_json::exception&) {
      continue;  // `audit` complains of it
    }
    // A longer id may begin with this one.
    const std::size_t at = what.find(job);
    const std::size_t after = at == std::string::npos ? at : at + job.size();
    if (at == std::string::npos || (after < what.size() && what[after] != ' ')) continue;
    entries.push_back({unix_ms, std::move(who), std::move(what)});
  }
  return {};
}

Result<ExitCode> run(const LogsOptions& o, const std::stop_token& stop) {
  const std::filesystem::path folder{o.data};
  std::error_code error;
  if (!std::filesystem::exists(folder / "jobs.sqlite", error))
    return fail(ErrorCode::NotFound, fmt::format("{} is not a folder of a daemon: it holds no jobs.sqlite", o.data));
  SystemClock clock;
  const auto store = JobStore::open(folder / "jobs.sqlite", clock);
  if (!store) return tl::unexpected{store.error()};
  const auto job = (*store)->find(o.job);
  if (!job) return tl::unexpected{job.error()};
  std::vector<LogEntry> entries;
  for (const auto& part : audit_parts(folder / "audit.log"))
    if (auto taken = take_audit_lines(part, o.job, entries); !taken) return tl::unexpected{taken.error()};
  std::uint64_t last = 0;
  const auto take_events = [&](std::vector<LogEntry>& into) -> Result<void> {
    const auto events = (*store)->events(o.job, last, kMostEvents);
    if (!events) return tl::unexpected{events.error()};
    for (const JobEvent& event : *events) {
      into.push_back({event.unix_ms, "", event.text});
      last = event.number;
    }
    return {};
  };
  if (auto taken = take_events(entries); !taken) return tl::unexpected{taken.error()};
  std::ranges::stable_sort(entries, {}, &LogEntry::unix_ms);
  for (const LogEntry& entry : entries) print(entry, o.json);
  // Whoever follows reads as it comes; where nobody reads any more there is nothing to wait for.
  while (o.follow && flush_output() && is_output_read() && !stop.stop_requested()) {
    const auto now = (*store)->find(o.job);
    if (!now) return tl::unexpected{now.error()};
    std::vector<LogEntry> more;
    if (auto taken = take_events(more); !taken) return tl::unexpected{taken.error()};
    for (const LogEntry& entry : more) print(entry, o.json);
    if (is_final(now->state)) break;
    clock.sleep_for(kLookEvery);
  }
  return ExitCode::Ok;
}

}  // namespace

VerbBody declare_logs(VerbOptions& options) {
  auto o = std::make_shared<LogsOptions>();
  options.add("JOB", o->job, "id of the job, as `telefab jobs` lists it").required();
  options.add("--data", o->data, "the daemon's folder").required();
  options.flag("--follow", o->follow, "go on until the job ends");
  options.flag("--json", o->json, "one JSON object a line: unix_ms, who, text");
  options.footer("The service's own lines on a job: journalctl JOB=...\n");
  return [o](const std::stop_token& stop) { return run(*o, stop); };
}

}  // namespace telefab
