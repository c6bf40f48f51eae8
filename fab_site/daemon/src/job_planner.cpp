// SPDX-License-Identifier: GPL-3.0-or-later
#include "job_planner.hpp"

#include <fmt/format.h>

#include <telefab/fab/planning/plan_room.hpp>
#include <telefab/service/log.hpp>
#include <telefab/service/profile_choice.hpp>

#include "accuracy.hpp"
#include "intake.hpp"
#include "job_room.hpp"
#include "plan_print.hpp"

namespace telefab::fab {

JobPlanner::JobPlanner(Site& site, PlanOptions options, JobPrinter& printer)
    : site_{site},
      options_{std::move(options)},
      printer_{printer},
      predictor_{"predictor", [this](const std::string& job, std::stop_token stop) { compute_accuracy(job, stop); }},
      queue_{"planner", [this](const std::string& job, std::stop_token stop) { plan(job, stop); }} {
  site.tracker().on_end([this](const std::string& job) {
    const std::scoped_lock lock{mutex_};
    analysed_.erase(job);
  });
}

JobPlanner::~JobPlanner() {
  predictor_.end();
  queue_.end();
}

void JobPlanner::add(const std::string& job, std::shared_ptr<LayerStream> analysis) {
  if (analysis) {
    const std::scoped_lock lock{mutex_};
    analysed_[job] = std::move(analysis);
  }
  queue_.add(job);
}

bool JobPlanner::drop(const std::string& job) {
  const bool was_planned = queue_.drop(job);
  return predictor_.drop(job) || was_planned;
}

void JobPlanner::ask_to_end() {
  predictor_.ask_to_end();
  queue_.ask_to_end();
}

void JobPlanner::plan(const std::string& job, std::stop_token stop) {
  if (const auto now = site_.store().find(job); now && is_final(now->state)) return;  // it waited, and was cancelled
  const Nanoseconds began = site_.clock().now();
  Result<PlanOutcome> outcome = fail(ErrorCode::Internal, "not begun");
  try {
    outcome = attempt(job, stop);
  } catch (const std::exception& error) {
    outcome = fail(ErrorCode::Internal, fmt::format("planning: a fault of Telefab: {}", error.what()));
  }
  if (stop.stop_requested()) return;  // planned again at the next start, or cancelled
  const double seconds = std::chrono::duration<double>(site_.clock().now() - began).count();
  site_.loop().post([this, job, outcome, seconds] {
    JobTracker& tracker = site_.tracker();
    if (!outcome && is_storage_trouble(outcome.error())) return wait(job, outcome.error());
    if (!outcome) return tracker.end(job, JobState::Failed, outcome.error().what);
    count(job, outcome->print_layers, outcome->print_layers);
    tracker.set_stage_seconds(job, JobStage::Plan, seconds);
    printer_.planned(job, outcome->preflight);
    predictor_.add(job);
  });
}

void JobPlanner::wait(const std::string& job, const Error& why) {
  if (const auto now = site_.store().find(job); now && is_final(now->state)) return;
  site_.tracker().wait_for_disk(job, JobState::Planning, why);
  site_.loop().after(site_.options().retry_every, [this, job] { queue_.add(job); });
}

Result<PlanOutcome> JobPlanner::attempt(const std::string& job, std::stop_token stop) {
  const auto found = site_.find(job);
  if (!found) return tl::unexpected{found.error()};
  const auto machine = profile_of_job(site_.profiles(), found->job.machine, found->job.parameters);
  if (!machine) return tl::unexpected{machine.error()};
  const auto part = received_stack(found->folder);
  if (!part) return tl::unexpected{part.error()};
  // A disk that will never do may be made larger; nothing of a job that was taken is given up for it.
  if (const auto room = site_.room().check(plan_room_bytes(part->layers, part->bytes())); !room)
    return fail(ErrorCode::StorageFailed, "the fab is full: " + room.error().what);
  if (!found->job.message.empty())
    site_.loop().post([this, job] { site_.tracker().move(job, JobState::Planning, ""); });
  const std::uint32_t layers = part->layers.header().layer_count;
  PlanOptions options = options_;
  options.job = job;
  options.regions = take_analysed(job, layers);
  return plan_into(
      found->folder, *part, *machine, std::move(options), site_.clock(),
      [&](const Progress& progress) {
        if (progress.stage != WorkStage::MakingMasks) return;
        // How many layers the supports add is known at the end only.
        site_.loop().post([this, job, layers, done = static_cast<std::uint32_t>(progress.fraction * layers)] {
          count(job, done, layers);
        });
      },
      std::move(stop));
}

std::shared_ptr<const PartRegions> JobPlanner::take_analysed(const std::string& job, std::uint32_t layers) {
  std::shared_ptr<LayerStream> analysis;
  {
    const std::scoped_lock lock{mutex_};
    const auto found = analysed_.find(job);
    if (found == analysed_.end()) return nullptr;
    analysis = std::move(found->second);
    analysed_.erase(found);
  }
  auto part = analysis->finish();
  // What went wrong is said by the planner, which begins again.
  if (!part || part->layers.size() != layers) return nullptr;
  return std::make_shared<const PartRegions>(std::move(*part));
}

void JobPlanner::count(const std::string& job, std::uint32_t done, std::uint32_t all) {
  site_.tracker().counters().change(job, [&](JobCounters& c) {
    c.print_layers = all;
    c.layers_planned = done;
  });
}

void JobPlanner::compute_accuracy(const std::string& job, std::stop_token stop) {
  Result<void> outcome = fail(ErrorCode::Internal, "not begun");
  try {
    outcome = attempt_accuracy(job, stop);
  } catch (const std::exception& error) {
    outcome = fail(ErrorCode::Internal, fmt::format("a fault of Telefab: {}", error.what()));
  }
  // The print needs none of it; whoever looks for the picture finds the reason in the log.
  if (!outcome && !stop.stop_requested())
    site_.loop().post([job, why = outcome.error().what] {
      log_line(fmt::format("job {}: no accuracy picture: {}", job, why), {job});
    });
}

Result<void> JobPlanner::attempt_accuracy(const std::string& job, const std::stop_token& stop) {
  const auto found = site_.find(job);
  if (!found) return tl::unexpected{found.error()};
  std::error_code error;
  if (std::filesystem::exists(found->folder / "report" / "accuracy.png", error)) return {};
  const auto choice = profile_choice_of(found->job.machine, found->job.parameters);
  if (!choice) return tl::unexpected{choice.error()};
  return keep_accuracy(found->folder, *choice, site_.options().machines, stop);
}

}  // namespace telefab::fab
