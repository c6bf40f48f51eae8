// SPDX-License-Identifier: GPL-3.0-or-later
#include <fmt/format.h>

#include <algorithm>
#include <nlohmann/json.hpp>
#include <telefab/base/json_text.hpp>
#include <telefab/job/job.hpp>

namespace telefab {

std::string_view name_of(JobState state) {
  switch (state) {
    case JobState::Queued:
      return "queued";
    case JobState::Slicing:
      return "slicing";
    case JobState::Sending:
      return "sending";
    case JobState::Planning:
      return "planning";
    case JobState::AwaitingApproval:
      return "awaiting-approval";
    case JobState::Ready:
      return "ready";
    case JobState::Printing:
      return "printing";
    case JobState::Paused:
      return "paused";
    case JobState::Done:
      return "done";
    case JobState::Failed:
      return "failed";
    case JobState::Cancelled:
      return "cancelled";
  }
  return "failed";
}

Result<JobState> job_state_from_name(std::string_view name) {
  for (const JobState state : kJobStates)
    if (name_of(state) == name) return state;
  return fail(ErrorCode::InvalidInput, fmt::format("{} is not a state of a job", name));
}

std::string_view name_of(JobCommand command) {
  switch (command) {
    case JobCommand::Approve:
      return "approve";
    case JobCommand::Pause:
      return "pause";
    case JobCommand::Resume:
      return "resume";
    case JobCommand::Cancel:
      return "cancel";
    case JobCommand::TreatAsExposed:
      return "resume as treat-as-exposed";
    case JobCommand::ExposeAgain:
      return "resume as expose-again";
    case JobCommand::Cleared:
      return "cleared";
    case JobCommand::Forget:
      return "forget";
    case JobCommand::StartAgain:
      return "resume as start-again";
    case JobCommand::TreatAsStarted:
      return "resume as treat-as-started";
  }
  return "cancel";
}

std::string_view name_of(JobStage stage) {
  switch (stage) {
    case JobStage::Slice:
      return "slice";
    case JobStage::Send:
      return "send";
    case JobStage::Plan:
      return "plan";
    case JobStage::Print:
      return "print";
  }
  return "print";
}

Result<JobStage> job_stage_from_name(std::string_view name) {
  for (const JobStage stage : kJobStages)
    if (name_of(stage) == name) return stage;
  return fail(ErrorCode::InvalidInput, fmt::format("{} is not a stage of a job", name));
}

bool is_before(JobState a, JobState b) { return std::ranges::find(kJobStates, a) < std::ranges::find(kJobStates, b); }

bool is_final(JobState state) {
  return state == JobState::Done || state == JobState::Failed || state == JobState::Cancelled;
}

bool may_follow(JobState from, JobState to) {
  if (is_final(from)) return false;
  if (to == JobState::Failed || to == JobState::Cancelled) return true;
  if (from == JobState::Paused && to == JobState::Printing) return true;
  // An approval grows old: at a start of the site the job asks for it again.
  if (from == JobState::Ready && to == JobState::AwaitingApproval) return true;
  // An operator changed its supports: it is planned again, and asks for approval of that plan.
  if (from == JobState::AwaitingApproval && to == JobState::Planning) return true;
  // A pause ends by resume, cancel or failure; nothing else leads out of it.
  return from != JobState::Paused && is_before(from, to);
}

std::string to_json(const Job& job) {
  nlohmann::ordered_json stages = nlohmann::ordered_json::object();
  for (const StageSeconds& stage : job.stages) stages[name_of(stage.stage)] = stage.seconds;
  auto parameters = json_or_discarded(job.parameters);
  if (parameters.is_discarded()) parameters = nullptr;
  const JobCounters& c = job.counters;
  const nlohmann::ordered_json object{
      {"id", job.id},
      {"name", job.name},
      {"machine", job.machine},
      {"instance", job.instance},
      {"state", name_of(job.state)},
      {"message", job.message},
      {"owner", job.owner},
      {"layers", c.layers},
      {"layers_sliced", c.layers_sliced},
      {"layers_sent", c.layers_sent},
      {"print_layers", c.print_layers},
      {"layers_planned", c.layers_planned},
      {"layers_printed", c.layers_printed},
      {"scan_bytes", c.scan_bytes},
      {"wire_bytes", c.wire_bytes},
      {"seconds", stages},
      {"parameters", parameters},
      {"created_unix_ms", job.created_unix_ms},
      {"changed_unix_ms", job.changed_unix_ms},
  };
  return json_text(object);
}

}  // namespace telefab
