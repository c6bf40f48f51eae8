// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <array>
#include <telefab/fab/web/page_backend.hpp>
#include <vector>

namespace telefab::fab {

/// What the machine is at: the job being printed, else the one that is nearest to it, else the newest. Null: no job.
[[nodiscard]] inline const JobView* job_on_machine(const std::vector<JobView>& jobs) {
  static constexpr std::array kNearest{JobState::Printing,         JobState::Paused,   JobState::Ready,
                                       JobState::AwaitingApproval, JobState::Planning, JobState::Sending};
  for (const JobState state : kNearest)
    for (const JobView& job : jobs)
      if (job.state == state) return &job;
  return jobs.empty() ? nullptr : &jobs.front();
}

}  // namespace telefab::fab
