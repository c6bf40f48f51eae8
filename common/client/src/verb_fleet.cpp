// SPDX-License-Identifier: GPL-3.0-or-later
#include <fmt/format.h>

#include <algorithm>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <telefab/base/json_text.hpp>
#include <telefab/base/person_name.hpp>
#include <telefab/command_line/output.hpp>
#include <telefab/fleet/fleet_words.hpp>
#include <telefab/store/fleet_queue.hpp>

#include "verbs.hpp"

namespace telefab::client {
namespace {

constexpr std::size_t kMostJobs = 100'000;

struct FleetOptions {
  std::string queue;
  std::string action = "machines";
  std::string name;
  std::string as;
  std::string who = "somebody";
  std::uint32_t most = 100;
  bool all = false;
  bool json = false;
};

/// What an action needs beside the queue.
Result<void> check(const FleetOptions& o) {
  const bool needs_name = o.action != "machines" && o.action != "jobs" && o.action != "events" && o.action != "dry-run";
  if (needs_name && o.name.empty())
    return fail(ErrorCode::InvalidInput, fmt::format("telefab fleet {} needs the NAME of a {}", o.action,
                                                     o.action == "drain" || o.action == "restore" ? "machine" : "job"));
  if (o.action == "decide" && o.as.empty())
    return fail(ErrorCode::InvalidInput,
                "telefab fleet decide needs --as waiting, done or failed: look at the machine");
  if (!is_person_name(o.who, ".-_@+", 64))
    return fail(ErrorCode::InvalidInput, fmt::format("--who {}: not a name", o.who));
  return {};
}

template <class Value>
void print_list(const std::vector<Value>& values) {
  std::string list;
  for (const Value& value : values) list += (list.empty() ? "" : ",\n ") + to_json(value);
  write_output(fmt::format("[{}]\n", list));
}

void print(const fleet::Job& job, bool json) {
  write_output(json ? to_json(job) + "\n"
                    : fmt::format("{:<28} {:<10} {:<24} {:>3}  {}{}\n", job.id, name_of(job.state), job.machine,
                                  job.priority, job.name, job.message.empty() ? "" : ": " + job.message));
}

Result<std::vector<fleet::Job>> jobs_of(FleetQueue& queue, const FleetOptions& o) {
  auto jobs = o.all ? queue.jobs({}, 0, kMostJobs) : queue.jobs(fleet::kOpenStates, 0, kMostJobs);
  if (jobs) std::ranges::sort(*jobs, fleet::is_before);
  return jobs;
}

Result<void> list_machines(FleetQueue& queue, const FleetOptions& o) {
  const auto machines = queue.machines();
  if (!machines) return tl::unexpected{machines.error()};
  const auto now = queue.now_unix_ms();
  if (!now) return tl::unexpected{now.error()};
  if (o.json) {
    print_list(*machines);
    return {};
  }
  if (machines->empty()) write_output("no fab has announced a machine yet\n");
  for (const fleet::Machine& m : *machines) {
    const bool is_lost = !fleet::is_seen(m, *now);
    write_output(fmt::format("{:<24} {:<10} {:<20} {:<16} {}\n", m.name,
                             is_lost         ? "not seen"
                             : m.is_draining ? "draining"
                                             : name_of(m.readiness),
                             m.profile, m.resin, m.fab));
  }
  return {};
}

Result<void> list_jobs(FleetQueue& queue, const FleetOptions& o) {
  const auto jobs = jobs_of(queue, o);
  if (!jobs) return tl::unexpected{jobs.error()};
  if (o.json)
    print_list(*jobs);
  else
    for (const fleet::Job& job : *jobs) print(job, false);
  return {};
}

/// Of every machine what keeps a job off it, as the queue would judge now.
Result<void> explain(FleetQueue& queue, const FleetOptions& o) {
  const auto job = queue.find(o.name);
  if (!job) return tl::unexpected{job.error()};
  const auto machines = queue.machines();
  if (!machines) return tl::unexpected{machines.error()};
  const auto waiting = jobs_of(queue, {});
  if (!waiting) return tl::unexpected{waiting.error()};
  const auto now = queue.now_unix_ms();
  if (!now) return tl::unexpected{now.error()};
  const std::vector<fleet::WhyNot> whys = fleet::why_nots(*job, *waiting, *machines, *now);
  nlohmann::ordered_json list = nlohmann::ordered_json::array();
  for (std::size_t place = 0; place < machines->size(); ++place) {
    const fleet::Machine& machine = (*machines)[place];
    const fleet::WhyNot why = whys[place];
    const std::string sentence = fleet::sentence_of(why, *job, machine, *now);
    if (o.json)
      list.push_back({{"machine", machine.name}, {"why", fleet::name_of(why)}, {"text", sentence}});
    else
      write_output(fmt::format("{:<24} {:<24} {}\n", machine.name, fleet::name_of(why), sentence));
  }
  if (o.json) write_output(json_text(list, 1) + "\n");
  if (!o.json && machines->empty()) write_output("no fab has announced a machine yet\n");
  return {};
}

Result<void> dry_run(FleetQueue& queue, const FleetOptions& o) {
  const auto jobs = jobs_of(queue, {});
  if (!jobs) return tl::unexpected{jobs.error()};
  auto machines = queue.machines();
  if (!machines) return tl::unexpected{machines.error()};
  const auto now = queue.now_unix_ms();
  if (!now) return tl::unexpected{now.error()};
  nlohmann::ordered_json list = nlohmann::ordered_json::array();
  for (const fleet::Placed& placed : fleet::place(*jobs, std::move(*machines), *now))
    if (o.json)
      list.push_back({{"job", placed.job}, {"machine", placed.machine}});
    else
      write_output(fmt::format("{:<28} -> {}\n", placed.job, placed.machine));
  if (o.json) write_output(json_text(list, 1) + "\n");
  return {};
}

Result<void> list_events(FleetQueue& queue, const FleetOptions& o) {
  nlohmann::ordered_json list = nlohmann::ordered_json::array();
  const auto events = queue.newest_events(o.most);
  if (!events) return tl::unexpected{events.error()};
  for (const fleet::Event& event : *events)
    if (o.json)
      list.push_back({{"number", event.number},
                      {"unix_ms", event.unix_ms},
                      {"job", event.job},
                      {"machine", event.machine},
                      {"text", event.text}});
    else
      write_output(fmt::format("{:>8} {:<28} {:<24} {}\n", event.number, event.job, event.machine, event.text));
  if (o.json) write_output(json_text(list, 1) + "\n");
  return {};
}

Result<void> change(FleetQueue& queue, const FleetOptions& o) {
  if (o.action == "drain" || o.action == "restore") {
    auto set = queue.drain(o.name, o.action == "drain", o.who);
    return set ? list_machines(queue, o) : set;
  }
  const auto decided = [&]() -> Result<fleet::Job> {
    if (o.action == "cancel") return queue.cancel(o.name, o.who);
    return queue.decide(o.name,
                        o.as == "waiting" ? fleet::State::Waiting
                        : o.as == "done"  ? fleet::State::Done
                                          : fleet::State::Failed,
                        o.who);
  }();
  if (!decided) return tl::unexpected{decided.error()};
  print(*decided, o.json);
  return {};
}

Result<ExitCode> run(const FleetOptions& o) {
  if (auto asked = check(o); !asked) return tl::unexpected{asked.error()};
  // A name that is mistyped would be a new fleet, and an empty one.
  constexpr std::string_view kFile = "sqlite:";
  std::error_code unseen;
  if (o.queue.starts_with(kFile) && !std::filesystem::exists(o.queue.substr(kFile.size()), unseen) && !unseen)
    return fail(ErrorCode::NotFound,
                fmt::format("--fleet {}: no such file; name the one that the fabs were started with", o.queue));
  const SystemClock clock;
  const auto queue = open_fleet(o.queue, clock);
  if (!queue) return tl::unexpected{queue.error()};
  const auto done = o.action == "machines"  ? list_machines(**queue, o)
                    : o.action == "jobs"    ? list_jobs(**queue, o)
                    : o.action == "why"     ? explain(**queue, o)
                    : o.action == "dry-run" ? dry_run(**queue, o)
                    : o.action == "events"  ? list_events(**queue, o)
                                            : change(**queue, o);
  if (!done) return tl::unexpected{done.error()};
  return ExitCode::Ok;
}

}  // namespace

VerbBody declare_fleet(VerbOptions& options) {
  auto o = std::make_shared<FleetOptions>();
  options
      .add("ACTION", o->action,
           "machines, jobs, why (each machine does not print the job NAME), dry-run (what would be claimed now), "
           "events; "
           "drain or restore the machine NAME; cancel the job NAME, or decide about one whose fab is not heard of")
      .one_of({"machines", "jobs", "why", "dry-run", "events", "drain", "restore", "cancel", "decide"});
  options.add("NAME", o->name, "of a job, or of a machine");
  options
      .add("--fleet", o->queue,
           "the fleet's queue: postgresql://USER@HOST/DATABASE?sslmode=verify-full, or sqlite:FILE")
      .environment("TELEFAB_FLEET")
      .required();
  options.add("--as", o->as, "what is decided: waiting (the part is lost, it is made again), done, or failed")
      .one_of({"waiting", "done", "failed"});
  options.add("--who", o->who, "who decides, for the fleet's events").environment("USER");
  options.add("--most", o->most, "events at most, the newest").within(1U, 100'000U).shows_default();
  options.flag("--all", o->all, "jobs: also those that have ended");
  options.flag("--json", o->json, "as JSON");
  options.footer(
      "Who may do what is the database's to say: its passwords lie in ~/.pgpass, PGPASSFILE or a service file, never "
      "on a "
      "command line.");
  return [o](std::stop_token) { return run(*o); };
}

}  // namespace telefab::client
