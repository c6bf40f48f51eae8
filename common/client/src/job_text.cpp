// SPDX-License-Identifier: GPL-3.0-or-later
#include "job_text.hpp"

#include <fmt/format.h>
#include <telefab/base/text.hpp>

namespace telefab::client {

double progress_of(const Job& job) {
  const auto share = [](std::uint32_t part, std::uint32_t whole) {
    return whole == 0 ? 0.0 : static_cast<double>(part) / static_cast<double>(whole);
  };
  const JobCounters& c = job.counters;
  switch (job.state) {
    case JobState::Slicing:
      return share(c.layers_sliced, c.layers);
    case JobState::Sending:
      return share(c.layers_sent, c.layers);
    case JobState::Planning:
      return share(c.layers_planned, c.print_layers);
    case JobState::Printing:
    case JobState::Paused:
      return share(c.layers_printed, c.print_layers);
    case JobState::Done:
      return 1;
    default:
      return 0;
  }
}

std::string progress_text(const Job& job) {
  const JobCounters& c = job.counters;
  switch (job.state) {
    case JobState::Slicing:
      return c.layers == 0
                 ? std::string{"slicing: reading the scan"}
                 : fmt::format("slicing: {} of {} layers, {} at the fab", c.layers_sliced, c.layers, c.layers_sent);
    case JobState::Sending:
      return fmt::format("sending: {} of {} layers", c.layers_sent, c.layers);
    case JobState::Planning:
      return c.print_layers == 0 ? std::string{"planning: supports"}
                                 : fmt::format("planning: {} of {} masks", c.layers_planned, c.print_layers);
    case JobState::Printing:
    case JobState::Paused:
      return fmt::format("{}{}: {} of {} layers", name_of(job.state),
                         job.instance.empty() || job.instance == job.machine ? "" : " on " + job.instance,
                         c.layers_printed, c.print_layers);
    default:
      return std::string{name_of(job.state)};
  }
}

std::string machine_text(const Job& job) {
  if (job.instance.empty() || job.instance == job.machine) return job.machine;
  return fmt::format("{} ({})", job.instance, job.machine);
}

std::string to_line(const Job& job) {
  std::string line = fmt::format("{:<18} {:<10} {:<12} {:>5.1f} %  {}", job.id, name_of(job.state), machine_text(job),
                                 100 * progress_of(job), job.name);
  if (!job.message.empty()) line += fmt::format("  ({})", job.message);
  return to_printable(line);  // it comes from a site
}

std::string summary_of(const Job& job) {
  const JobCounters& c = job.counters;
  std::string text = fmt::format("job {} {}", job.id, name_of(job.state));
  if (!job.message.empty()) text += fmt::format(": {}", to_printable(job.message));
  if (!job.instance.empty()) text += fmt::format("\n  machine         {}", to_printable(machine_text(job)));
  text += fmt::format("\n  layers printed  {} of {} ({} of the part)\n  bytes sent      {} for {} bytes of scan\n",
                      c.layers_printed, c.print_layers, c.layers, c.wire_bytes, c.scan_bytes);
  for (const StageSeconds& stage : job.stages)
    text += fmt::format("  {:<15} {:.2f} s\n", name_of(stage.stage), stage.seconds);
  return text;
}

ExitCode exit_code_of(const Job& job) {
  if (job.state == JobState::Failed) return ExitCode::JobFailed;
  if (job.state == JobState::Cancelled) return ExitCode::Cancelled;
  return ExitCode::Ok;
}

}  // namespace telefab::client
