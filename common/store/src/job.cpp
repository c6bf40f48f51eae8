#include <fmt/format.h>

#include <telefab/store/job.hpp>

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
  return fail(ErrorCode::InvalidInput, fmt::format("{} is no state of a job", name));
}

bool is_final(JobState state) {
  return state == JobState::Done || state == JobState::Failed || state == JobState::Cancelled;
}

bool may_follow(JobState from, JobState to) {
  if (is_final(from)) return false;
  if (to == JobState::Failed || to == JobState::Cancelled) return true;
  if (from == JobState::Paused && to == JobState::Printing) return true;
  // A pause ends by resume, cancel or failure; nothing else leads out of it.
  return from != JobState::Paused && from < to;
}

}  // namespace telefab
