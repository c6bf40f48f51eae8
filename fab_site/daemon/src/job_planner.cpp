// SPDX-License-Identifier: GPL-3.0-or-later
#include "job_planner.hpp"

#include <fmt/format.h>

#include <telefab/fab/planning/plan_room.hpp>
#include <telefab/service/log.hpp>
#include <telefab/service/profile_choice.hpp>

#include "accuracy.hpp"
#include "intake.hpp"
#include "job_room.hpp"
#include "job_supports.hpp"
#include "plan_print.hpp"
#include "upload.hpp"

namespace telefab::fab {

JobPlanner::JobPlanner(Site& site, PlanOptions options, JobDispatcher& dispatcher)
    : site_{site},
      options_{std::move(options)},
      dispatcher_{dispatcher},
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
  give_way();  // to the prints that run beside it, and so do the threads that solve its masks
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
    if (!outcome && stays_as_before(job, outcome.error())) return;
    if (!outcome) return tracker.end(job, JobState::Failed, outcome.error().what);
    if (const auto folder = site_.folder().job(job); folder && wants_hand_list(*folder)) replaced(*folder, job);
    count(job, outcome->print_layers, outcome->print_layers);
    tracker.set_stage_seconds(job, JobStage::Plan, seconds);
    dispatcher_.planned(job, outcome->preflight);
    predictor_.add(job);
  });
}

Result<Job> JobPlanner::plan_again(const std::string& job, const HandList& supports, const std::string& who) {
  const auto found = site_.find(job);
  if (!found) return tl::unexpected{found.error()};
  const auto refuse = [&](std::string_view why) {
    return fail(ErrorCode::Conflict, fmt::format("job {} is {}: {}", job, name_of(found->job.state), why));
  };
  const JobState state = found->job.state;
  if (is_final(state)) return refuse("it has ended; send it again to have other supports");
  if (is_before(state, JobState::AwaitingApproval)) return refuse("its supports can be changed once it is planned");
  // An approval is of the plan that was looked at, and whatever is approved may light at any moment.
  if (state == JobState::Ready) return refuse("it is approved; its supports can be changed only before that");
  if (state != JobState::AwaitingApproval) return refuse("it is on its machine; its supports can no longer be changed");
  if (has_ready_print(found->folder)) return refuse("it came as masks, and its supports are part of them");
  std::error_code error;
  if (std::filesystem::exists(found->folder / "journal", error) || error)
    return refuse("its journal has an approval of the plan before; cancel it and send it again to have other supports");
  if (auto held = hold_for_approval(found->folder); !held) return tl::unexpected{held.error()};
  if (auto wanted = want_hand_list(found->folder, supports); !wanted) return tl::unexpected{wanted.error()};
  predictor_.drop(job);
  site_.tracker().note(who,
                       fmt::format("plans job {} again with {} anchors added, {} removed, {} places kept free", job,
                                   supports.extra.size(), supports.removed.size(), supports.forbidden.size()));
  count(job, 0, found->job.counters.print_layers);
  site_.tracker().move(job, JobState::Planning, "");
  queue_.add(job);
  return site_.store().find(job);
}

void JobPlanner::replaced(const std::filesystem::path& folder, const std::string& job) {
  std::error_code error;
  std::filesystem::remove(folder / "report" / "accuracy.png", error);
  if (error) log_warning("the accuracy picture of the plan before is still there: " + error.message(), {job});
  // Where this fails the list stays the wanted one, which is read first.
  if (auto kept = keep_wanted_hand_list(folder); !kept) log_warning(kept.error().what, {job});
}

bool JobPlanner::stays_as_before(const std::string& job, const Error& why) {
  const auto folder = site_.folder().job(job);
  std::error_code error;
  if (!folder || !wants_hand_list(*folder) || !std::filesystem::exists(*folder / "plan" / "plan.json", error))
    return false;
  if (auto dropped = drop_wanted_hand_list(*folder); !dropped) log_warning(dropped.error().what, {job});
  site_.tracker().move(
      job, JobState::AwaitingApproval,
      fmt::format("waits for `telefab approve`: the plan is that of before, since no other could be made: {}",
                  why.what));
  predictor_.add(job);
  return true;
}

void JobPlanner::wait(const std::string& job, const Error& why) {
  if (const auto now = site_.store().find(job); now && is_final(now->state)) return;
  site_.tracker().wait_for_disk(job, JobState::Planning, why);
  site_.loop().after(site_.options().retry_every, [this, job] { queue_.add(job); });
}

Result<PlanOutcome> JobPlanner::attempt(const std::string& job, std::stop_token stop) {
  const auto found = site_.find(job);
  if (!found) return tl::unexpected{found.error()};
  const auto composed = composed_of_job(site_.profiles(), found->job.machine, found->job.parameters);
  if (!composed) return tl::unexpected{composed.error()};
  const MachineProfile* const machine = &composed->profile;
  if (has_ready_print(found->folder))
    if (auto traced = trace_masks(found->folder, found->job, *machine, stop); !traced)
      return tl::unexpected{traced.error()};
  const auto part = received_stack(found->folder);
  if (!part) return tl::unexpected{part.error()};
  // A disk that will never do may be made larger; nothing of a job that was taken is given up for it.
  if (const auto room = site_.room().check(plan_room_bytes(part->layers, part->bytes())); !room)
    return fail(ErrorCode::StorageFailed, "the fab is full: " + room.error().what);
  if (!found->job.message.empty())
    site_.loop().post([this, job] { site_.tracker().move(job, JobState::Planning, ""); });
  const std::uint32_t layers = part->layers.header().layer_count;
  if (found->job.counters.layers == 0)  // masks, which had to be traced first
    site_.loop().post([this, job, layers, bytes = part->bytes()] {
      site_.tracker().counters().change(job, [&](JobCounters& c) {
        c.layers = c.layers_sent = layers;
        c.wire_bytes = bytes;
      });
    });
  PlanOptions options = options_;
  options.job = job;
  options.price = composed->price;
  auto hand = hand_list_in(found->folder);
  if (!hand) return tl::unexpected{hand.error()};
  options.supports.hand = std::move(*hand);
  options.regions = take_analysed(job, layers);
  if (has_ready_print(found->folder)) {
    auto ready = ready_print_in(found->folder, *machine);
    if (!ready) return tl::unexpected{ready.error()};
    options.ready = std::move(*ready);
    options.masks = MaskMethod::Cover;
    options.pattern = {};
    options.cure_depth_layers = 0;
    options.supports.mode = SupportOptions::Mode::None;
  }
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
  // The verb knows the profiles of the folder, not the fab's list of machines.
  const auto composed = site_.profiles().compose(*choice);
  if (!composed) return tl::unexpected{composed.error()};
  return keep_accuracy(found->folder, {composed->profile.name, composed->resin, composed->print},
                       site_.options().machines, stop);
}

}  // namespace telefab::fab
