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
  std::uint32_t most = 100;
  bool names = false;
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
  auto o = std::make_shared<JobOptions>();
  declare_common(options, o->common);
  options.add("--most", o->most, "how many at most").within(1U, 1000U).shows_default();
  options.flag("--names", o->names, "ids alone, one a line");
  return [o](std::stop_token stop) -> Result<ExitCode> {
    auto client = connect(o->common, std::move(stop));
    if (!client) return tl::unexpected{client.error()};
    auto jobs = (*client)->ask<Jobs>(AskJobs{(*client)->next_request(), {}, o->most, false});
    if (!jobs) return tl::unexpected{jobs.error()};
    if (o->names) {
      for (const Job& job : jobs->jobs) write_output(fmt::format("{}\n", job.id));
    } else if (o->common.json) {
      std::string list;
      for (const Job& job : jobs->jobs) list += (list.empty() ? "" : ",\n ") + to_json(job);
      write_output(fmt::format("[{}]\n", list));
    } else {
      for (const Job& job : jobs->jobs) write_output(fmt::format("{}\n", to_line(job)));
    }
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
