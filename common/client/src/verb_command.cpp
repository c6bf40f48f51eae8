// SPDX-License-Identifier: GPL-3.0-or-later
#include <fmt/format.h>

#include <telefab/base/clock.hpp>
#include <telefab/base/text.hpp>
#include <telefab/command_line/output.hpp>

#include "common_options.hpp"
#include "job_text.hpp"
#include "verbs.hpp"

namespace telefab::client {
namespace {

/// A print that is asked to pause ends its layer first, and a scan site has the news of its fab a moment later.
constexpr auto kTakesEffectWithin = std::chrono::seconds{3};

/// Whether a job is where the command was to bring it; true for commands that change no state.
bool has_taken_effect(JobCommand command, JobState state) {
  switch (command) {
    case JobCommand::Pause:
      return state == JobState::Paused || is_final(state);
    case JobCommand::Resume:
    case JobCommand::TreatAsExposed:
    case JobCommand::ExposeAgain:
      return state != JobState::Paused;
    case JobCommand::Approve:
      return state != JobState::AwaitingApproval;
    case JobCommand::Cancel:
      return is_final(state);
    default:
      return true;
  }
}

/// The job once it is where the command was to bring it, or as it was last seen within the time. The command was
/// carried out by now: where looking fails, it is the job as the site answered.
Job seen_after(SiteClient& client, Job job, JobCommand command) {
  if (has_taken_effect(command, job.state) || !client.send(AskJobs{client.next_request(), job.id, 1, true})) return job;
  const SystemClock clock;
  const Nanoseconds until = clock.now() + kTakesEffectWithin;
  while (!has_taken_effect(command, job.state) && clock.now() < until) {
    auto received = client.receive_within(until - clock.now());
    if (!received || !*received) break;
    if (auto* jobs = std::get_if<Jobs>(&**received); jobs && jobs->jobs.size() == 1) job = std::move(jobs->jobs[0]);
  }
  return job;
}

/// One job's answer on a line.
Result<void> ask_and_print(SiteClient& client, const CommonOptions& common, const Command& command) {
  auto jobs = client.ask<Jobs>(command);
  if (!jobs) return tl::unexpected{jobs.error()};
  for (const Job& answered : jobs->jobs) {
    const Job job = seen_after(client, answered, command.command);
    write_output(fmt::format("{}\n", common.json ? to_json(job) : to_line(job)));
    if (!has_taken_effect(command.command, job.state))
      write_note(
          fmt::format("asked to {}; it is still {}, as while a layer is under way: `telefab watch {}` shows when "
                      "it takes effect\n",
                      name_of(command.command), name_of(job.state), job.id));
  }
  return {};
}

VerbBody declare_command(VerbOptions& options, JobCommand command) {
  struct Options {
    CommonOptions common;
    std::string job;
    std::string who;
    std::string as;
    std::vector<std::string> although;
  };
  auto o = std::make_shared<Options>();
  declare_common(options, o->common);
  const bool is_of_machine = command == JobCommand::Cleared;
  options.add(is_of_machine ? "MACHINE" : "JOB", o->job, is_of_machine ? "name of the machine" : "id of the job")
      .required();
  options.add("--who", o->who, "your name for the audit log; with --tls the certificate's name counts")
      .environment("USER");
  if (command == JobCommand::Resume)
    options
        .add("--as", o->as,
             "treat-as-exposed | expose-again: what to do about a layer that was perhaps exposed when the print broke "
             "off: treat-as-exposed goes on with the next layer, expose-again exposes it again. treat-as-started | "
             "start-again: about a whole printer that was asked to start and of which nobody knows whether it did: "
             "treat-as-started watches it, start-again asks it once more. `telefab watch` says when one of them is "
             "asked")
        .one_of({"treat-as-exposed", "expose-again", "treat-as-started", "start-again"});
  if (command == JobCommand::Approve)
    options
        .add("--although", o->although,
             "NAME of what holds the job, as its page and the answer to a plain approval list it; give every one. "
             "It is kept with your name in the as-built record")
        .separated_by(',');
  return [o, command, is_of_machine](std::stop_token stop) -> Result<ExitCode> {
    JobCommand asked = command;
    if (o->as == "treat-as-exposed") asked = JobCommand::TreatAsExposed;
    if (o->as == "expose-again") asked = JobCommand::ExposeAgain;
    if (o->as == "treat-as-started") asked = JobCommand::TreatAsStarted;
    if (o->as == "start-again") asked = JobCommand::StartAgain;
    if (is_of_machine && !is_job_id(o->job))
      return fail(ErrorCode::InvalidInput,
                  fmt::format("no machine {}: `telefab machines` lists them", to_printable(o->job)));
    if (auto named = check_job_id(o->job); !named) return tl::unexpected{named.error()};
    auto client = connect(o->common, std::move(stop));
    if (!client) return tl::unexpected{client.error()};
    const std::string although = fmt::format("{}", fmt::join(o->although, ",")).substr(0, kMaxNameBytes);
    const std::string who = o->who.substr(0, kMaxNameBytes);
    const Command spoken{(*client)->next_request(), o->job, asked, who, although};
    if (auto done = ask_and_print(**client, o->common, spoken); !done) return tl::unexpected{done.error()};
    return ExitCode::Ok;
  };
}

}  // namespace

VerbBody declare_forget(VerbOptions& options) {
  struct Options {
    CommonOptions common;
    std::vector<std::string> jobs;
    std::string who;
  };
  auto o = std::make_shared<Options>();
  declare_common(options, o->common);
  options.add("JOB", o->jobs, "ids of jobs that have ended; their scans, plans and pictures go, as-built records stay")
      .required();
  options.add("--who", o->who, "your name for the audit log; with --tls the certificate's name counts")
      .environment("USER");
  return [o](std::stop_token stop) -> Result<ExitCode> {
    for (const std::string& job : o->jobs)
      if (auto named = check_job_id(job); !named) return tl::unexpected{named.error()};
    auto client = connect(o->common, std::move(stop));
    if (!client) return tl::unexpected{client.error()};
    const std::string who = o->who.substr(0, kMaxNameBytes);
    for (const std::string& job : o->jobs)
      if (auto forgotten =
              ask_and_print(**client, o->common, {(*client)->next_request(), job, JobCommand::Forget, who, {}});
          !forgotten)
        return tl::unexpected{forgotten.error()};
    return ExitCode::Ok;
  };
}

VerbBody declare_approve(VerbOptions& options) { return declare_command(options, JobCommand::Approve); }
VerbBody declare_pause(VerbOptions& options) { return declare_command(options, JobCommand::Pause); }
VerbBody declare_resume(VerbOptions& options) { return declare_command(options, JobCommand::Resume); }
VerbBody declare_cleared(VerbOptions& options) { return declare_command(options, JobCommand::Cleared); }
VerbBody declare_cancel(VerbOptions& options) { return declare_command(options, JobCommand::Cancel); }

}  // namespace telefab::client
