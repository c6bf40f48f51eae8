// SPDX-License-Identifier: GPL-3.0-or-later
#include <fmt/format.h>

#include <telefab/command_line/output.hpp>

#include "common_options.hpp"
#include "job_text.hpp"
#include "verbs.hpp"
#include "watch_job.hpp"

namespace telefab::client {
namespace {

struct JobOptions {
  CommonOptions common;
  std::string job;
  bool plain = false;
  double patience_min = 10;
};

std::shared_ptr<JobOptions> declare_one(VerbOptions& options) {
  auto o = std::make_shared<JobOptions>();
  declare_common(options, o->common);
  options.add("JOB", o->job, "id of the job, as submit printed it").required();
  return o;
}

}  // namespace

VerbBody declare_jobs(VerbOptions& options) {
  struct Options {
    CommonOptions common;
    std::uint32_t most = 100;
    std::string search;
    std::vector<std::string> states;
    bool all = false;
    bool names = false;
  };
  auto o = std::make_shared<Options>();
  declare_common(options, o->common);
  options.add("--search", o->search,
              "only jobs in whose name, owner, id, machine or state each of these words occurs: --search \"vase ana\"");
  std::vector<std::string> states;
  for (const JobState state : kJobStates) states.emplace_back(name_of(state));
  options.add("--state", o->states, "only jobs in one of these states: --state done,failed")
      .one_of(std::move(states))
      .separated_by(',');
  options.add("--most", o->most, "how many at most, the newest first").within(1U, 1000U).shows_default();
  options.flag("--all", o->all, "all of them, however many");
  options.flag("--names", o->names, "ids alone, one a line");
  return [o](std::stop_token stop) -> Result<ExitCode> {
    AskJobs question;
    question.most = o->all ? static_cast<std::uint32_t>(kMaxJobsListed) : o->most;
    question.words = o->search;
    for (const std::string& name : o->states) {
      const auto state = job_state_from_name(name);
      if (!state) return tl::unexpected{state.error()};
      question.states.push_back(*state);
    }
    auto client = connect(o->common, std::move(stop));
    if (!client) return tl::unexpected{client.error()};
    std::string list;
    do {
      question.request = (*client)->next_request();
      const auto page = (*client)->ask<Jobs>(question);
      if (!page) return tl::unexpected{page.error()};
      for (const Job& job : page->jobs)
        if (o->common.json)
          list += (list.empty() ? "" : ",\n ") + to_json(job);
        else
          write_output(fmt::format("{}\n", o->names ? job.id : to_line(job)));
      question.before = page->next;
    } while (o->all && question.before > 0);
    if (o->common.json) write_output(fmt::format("[{}]\n", list));
    if (question.before > 0 && !o->names && !o->common.json)
      write_note("there are more: --all lists them, --search finds some\n");
    return ExitCode::Ok;
  };
}

VerbBody declare_status(VerbOptions& options) {
  auto o = declare_one(options);
  return [o](std::stop_token stop) -> Result<ExitCode> {
    if (auto good = check_job_id(o->job); !good) return tl::unexpected{good.error()};
    auto client = connect(o->common, std::move(stop));
    if (!client) return tl::unexpected{client.error()};
    auto jobs = (*client)->ask<Jobs>(AskJobs{(*client)->next_request(), o->job, 1, false});
    if (!jobs) return tl::unexpected{jobs.error()};
    for (const Job& job : jobs->jobs) {
      if (o->common.json)
        write_output(fmt::format("{}\n", to_json(job)));
      else
        write_output(fmt::format("{}\n{}", to_line(job), summary_of(job)));
    }
    return ExitCode::Ok;
  };
}

VerbBody declare_watch(VerbOptions& options) {
  auto o = declare_one(options);
  options.flag("--plain", o->plain, "lines instead of the full screen, as where there is no terminal");
  declare_patience(options, o->patience_min);
  return [o](std::stop_token stop) -> Result<ExitCode> {
    if (auto good = check_job_id(o->job); !good) return tl::unexpected{good.error()};
    auto client = connect(o->common, stop);
    if (!client) return tl::unexpected{client.error()};
    const WatchLine line{[&] { return connect(o->common, stop); }, o->patience_min, stop};
    auto job = watch_job(std::move(*client), line, o->job, watch_style(o->common.json, o->plain));
    if (!job) return tl::unexpected{job.error()};
    if (o->common.json)
      write_output(fmt::format("{}\n", to_json(*job)));
    else
      write_output(summary_of(*job));
    return exit_code_of(*job);
  };
}

}  // namespace telefab::client
