#include "metrics.hpp"

#include <prometheus/metric_family.h>
#include <prometheus/text_serializer.h>

#include <array>
#include <map>

namespace telefab::fab {
namespace {

using prometheus::ClientMetric;
using prometheus::MetricFamily;
using prometheus::MetricType;

ClientMetric sample(std::vector<ClientMetric::Label> labels, double value) {
  ClientMetric metric;
  metric.label = std::move(labels);
  metric.gauge.value = value;
  return metric;
}

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

MetricFamily family(const char* name, const char* help) { return {name, help, MetricType::Gauge, {}}; }

}  // namespace

std::string metrics_text(const std::vector<JobView>& jobs) {
  std::vector<MetricFamily> families;
  std::map<std::string, double> in_state;
  for (const JobView& job : jobs) ++in_state[job.state];
  MetricFamily states = family("telefab_jobs", "Jobs in each state; queued and ready ones wait");
  for (const char* state :
       {"queued", "slicing", "sending", "planning", "ready", "printing", "paused", "done", "failed", "cancelled"})
    states.metric.push_back(sample({{"state", state}}, in_state[state]));
  families.push_back(std::move(states));
  for (const JobGauge& gauge : kJobGauges) {
    MetricFamily each = family(gauge.name, gauge.help);
    for (const JobView& job : jobs)
      each.metric.push_back(
          sample({{"job", job.id}, {"machine", job.machine}, {"state", job.state}}, gauge.value(job)));
    families.push_back(std::move(each));
  }
  MetricFamily stages = family("telefab_job_stage_seconds", "What each stage of a job took");
  for (const JobView& job : jobs)
    for (const auto& [stage, seconds] : job.stage_seconds)
      stages.metric.push_back(sample({{"job", job.id}, {"stage", stage}}, seconds));
  families.push_back(std::move(stages));
  return prometheus::TextSerializer{}.Serialize(families);
}

}  // namespace telefab::fab
