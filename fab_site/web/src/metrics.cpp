// SPDX-License-Identifier: GPL-3.0-or-later
#include "metrics.hpp"

#include <array>
#include <map>
#include <telefab/web/gauges.hpp>

namespace telefab::fab {
namespace {

struct JobGauge {
  const char* name;
  const char* help;
  double (*value)(const JobView&);
};

constexpr std::array kJobGauges{
    JobGauge{"telefab_job_layers", "Layers of the print, supports included",
             [](const JobView& j) { return 1.0 * j.layers; }},
    JobGauge{"telefab_job_layers_received", "Layers of the part that have arrived",
             [](const JobView& j) { return 1.0 * j.layers_received; }},
    JobGauge{"telefab_job_layers_printed", "Layers exposed", [](const JobView& j) { return 1.0 * j.layers_printed; }},
    JobGauge{"telefab_job_bytes_received", "Contour bytes received, framing included",
             [](const JobView& j) { return static_cast<double>(j.bytes_received); }},
    JobGauge{"telefab_job_progress", "Share of the present state, 0 to 1", [](const JobView& j) { return j.progress; }},
    JobGauge{"telefab_job_seconds_left", "Of the print; below 0: not known",
             [](const JobView& j) { return j.seconds_left; }},
    JobGauge{"telefab_job_planned_exposure_seconds", "Light of the whole print as planned",
             [](const JobView& j) { return j.planned_exposure_s; }},
    JobGauge{"telefab_job_measured_exposure_seconds", "Light that the device reported",
             [](const JobView& j) { return j.measured_exposure_s; }},
    JobGauge{"telefab_job_retries", "Device commands that had to be repeated",
             [](const JobView& j) { return 1.0 * j.retries; }},
};

}  // namespace

std::string metrics_text(const std::vector<JobView>& jobs, const std::vector<MachineStatus>& machines) {
  Gauges gauges;
  std::map<JobState, double> in_state;
  for (const JobView& job : jobs) ++in_state[job.state];
  for (const JobState state : kJobStates)
    gauges.add("telefab_jobs", "Jobs in each state; queued, ready and unapproved ones wait",
               {{"state", std::string{name_of(state)}}}, in_state[state]);
  for (const JobGauge& gauge : kJobGauges)
    for (const JobView& job : jobs)
      gauges.add(gauge.name, gauge.help,
                 {{"job", job.id},
                  {"machine", job.machine},
                  {"on_machine", job.instance},
                  {"state", std::string{name_of(job.state)}}},
                 gauge.value(job));
  for (const JobView& job : jobs)
    for (const StageSeconds& stage : job.stage_seconds)
      gauges.add("telefab_job_stage_seconds", "What each stage of a job took",
                 {{"job", job.id}, {"stage", std::string{name_of(stage.stage)}}}, stage.seconds);
  for (const MachineStatus& machine : machines)
    for (const MachineState state : kMachineStates)
      gauges.add("telefab_machine_state", "1 for the state that a machine is in",
                 {{"machine", machine.name}, {"profile", machine.profile}, {"state", std::string{name_of(state)}}},
                 machine.state == state ? 1 : 0);
  for (const MachineStatus& machine : machines)
    gauges.add("telefab_machine_waiting_jobs", "Jobs that wait and that the machine could print",
               {{"machine", machine.name}}, machine.waiting);
  return gauges.text();
}

}  // namespace telefab::fab
