// SPDX-License-Identifier: GPL-3.0-or-later
#include <fmt/format.h>

#include <telefab/base/nearest_name.hpp>
#include <telefab/fab/planning/preflight.hpp>

#include "job_dispatcher.hpp"

// What operators say about jobs and machines.
namespace telefab::fab {

void JobDispatcher::command(const Job& job, const Command& command, std::function<void(Result<Job>)> done) {
  const auto refuse = [&](std::string_view why) {
    done(fail(ErrorCode::Conflict, fmt::format("job {} is {}: {}", job.id, name_of(job.state), why)));
  };
  if (is_final(job.state)) return refuse("it has ended");
  JobPrinter* const printer = printer_of(job.id);
  const std::shared_ptr<PrintControl> control = printer ? printer->control_of(job.id) : nullptr;
  const auto answer = [&](const Result<void>& outcome) {
    if (outcome)
      done(store().find(job.id));
    else
      done(tl::unexpected{outcome.error()});
  };
  PrintWord word{JournalStep::Resumed, command.who, {}, {}};
  switch (command.command) {
    case JobCommand::Approve:
      if (job.state != JobState::AwaitingApproval) return refuse("there is nothing to approve");
      return answer(approve(job, command));
    case JobCommand::Pause:
      if (job.state != JobState::Printing) return refuse("only a print can be paused");
      if (control) return pass_to_print(command, control, std::move(done));
      return answer(pause(job, command.who));
    case JobCommand::TreatAsExposed:
    case JobCommand::ExposeAgain:
      if (control && question_about(job.id) != OpenQuestion::Exposure)
        return refuse("no layer of it was perhaps exposed; resume it without saying what the layer was");
      word.decision = command.command == JobCommand::ExposeAgain ? Decision::ExposeAgain : Decision::TreatAsExposed;
      if (job.state != JobState::Paused) return refuse("it is not paused");
      if (control) return pass_to_print(command, control, std::move(done));
      return answer(let_print(job, word));
    case JobCommand::StartAgain:
    case JobCommand::TreatAsStarted:
      if (job.state != JobState::Paused) return refuse("it is not paused");
      if (control) return refuse("no start of it is in question; resume it without saying what came of it");
      word.start =
          command.command == JobCommand::StartAgain ? StartDecision::StartAgain : StartDecision::TreatAsStarted;
      return answer(let_print(job, word));
    case JobCommand::Resume:
      if (job.state != JobState::Paused) return refuse("it is not paused");
      if (control) return pass_to_print(command, control, std::move(done));
      return answer(let_print(job, word));
    case JobCommand::Cancel:
      if (control) return pass_to_print(command, control, std::move(done));
      return answer(cancel(job, command.who));
    case JobCommand::Cleared:
    case JobCommand::Forget:
      break;  // about a machine, or a job that has ended: the site's
  }
}

void JobDispatcher::pass_to_print(const Command& command, const std::shared_ptr<PrintControl>& control,
                                  std::function<void(Result<Job>)> done) {
  // Answered on the network thread once the journal has the word; a print that ended meanwhile hands it back.
  const WordKept kept = [this, command, done = std::move(done)](const std::optional<Result<void>>& outcome) {
    site_.loop().post([this, command, done, outcome] {
      if (outcome && !*outcome) return done(tl::unexpected{outcome->error()});
      const auto job = store().find(command.job);
      if (outcome || !job) return done(job);
      this->command(*job, command, done);
    });
  };
  switch (command.command) {
    case JobCommand::Pause:
      return control->pause(command.who, kept);
    case JobCommand::Cancel:
      return control->cancel(command.who, kept);
    case JobCommand::TreatAsExposed:
      return control->decide(Decision::TreatAsExposed, command.who, kept);
    case JobCommand::ExposeAgain:
      return control->decide(Decision::ExposeAgain, command.who, kept);
    default:
      return control->resume(command.who, kept);
  }
}

Result<void> JobDispatcher::keep(const Job& job, const PrintWord& word) {
  if (JobPrinter* const printer = printer_of(job.id)) return printer->keep(job, word);
  const auto folder = site_.folder().job(job.id);
  if (!folder) return tl::unexpected{folder.error()};
  return keep_word(*folder, job, light_of(job), word, site_.clock().wall());
}

Result<void> JobDispatcher::let_print(const Job& job, const PrintWord& word) {
  // What began on a machine that is not here any more goes on nowhere; it may still be cancelled.
  if (!queue_.begun_on(job.id)) {
    const auto folder = site_.folder().job(job.id);
    if (!folder) return tl::unexpected{folder.error()};
    const auto before = start_case(*folder, job, light_of(job));
    if (!before) return tl::unexpected{before.error()};
    if (is_part_begun(*before, job)) {
      const auto place = where_begun(job);
      if (!place) return tl::unexpected{place.error()};
      queue_.begin(job.id, **place);
    }
  }
  if (auto kept = keep(job, word); !kept) return kept;
  questions_.set(job.id, OpenQuestion::None);
  only_watched_.erase(job.id);
  if (job.state == JobState::AwaitingApproval || job.state == JobState::Ready)
    tracker().move(job.id, JobState::Ready, "");
  // Before the answer: a start whose list still says paused would wait for the word again.
  if (job.state == JobState::Paused) tracker().move(job.id, JobState::Printing, "waits for its machine");
  wait_for_machine(job.id, word.step == JournalStep::Resumed ? InTrouble::Tries : InTrouble::Waits);
  return {};
}

Result<void> JobDispatcher::approve(const Job& job, const Command& command) {
  const auto folder = site_.folder().job(job.id);
  if (!folder) return tl::unexpected{folder.error()};
  const auto preflight = preflight_in(*folder / "plan");
  if (!preflight) return tl::unexpected{preflight.error()};
  const auto why = let_through(*preflight, command.although);
  if (!why) return fail_in(fmt::format("job {}", job.id), why.error());
  return let_print(job, {JournalStep::Approved, command.who, *why, {}});
}

Result<bool> JobDispatcher::is_at_printer(const Job& job) {
  if (JobPrinter* const printer = printer_of(job.id))
    return printer->case_of(job).map([](const StartCase& c) { return c.facts.is_at_printer; });
  const auto folder = site_.folder().job(job.id);
  if (!folder) return tl::unexpected{folder.error()};
  return start_case(*folder, job, light_of(job)).map([](const StartCase& c) { return c.facts.is_at_printer; });
}

void JobDispatcher::pass_to_printer(const Job& job, std::string_view message) {
  questions_.set(job.id, OpenQuestion::None);
  tracker().move(job.id, JobState::Printing, message);
  if (!printer_of(job.id)) watch(job.id);
}

Result<void> JobDispatcher::pause(const Job& job, const std::string& who) {
  const auto at_printer = is_at_printer(job);
  if (!at_printer) return tl::unexpected{at_printer.error()};
  if (auto kept = keep(job, {JournalStep::PauseAsked, who, {}, {}}); !kept) return kept;
  if (*at_printer) {
    pass_to_printer(job, fmt::format("its printer is asked to pause, by {}", who));
    return {};
  }
  if (JobPrinter* const printer = printer_of(job.id)) printer->take_off(job.id);
  queue_.drop(job.id);
  queue_.release(job.id, MachineTrouble::None);
  explained_.erase(job.id);
  tracker().move(job.id, JobState::Paused, "");
  dispatch_soon();
  return {};
}

Result<void> JobDispatcher::cancel(const Job& job, const std::string& who) {
  const auto at_printer = is_at_printer(job);
  // What cannot be read is cancelled all the same: nothing of it prints here any more.
  if (!at_printer && at_printer.error().code == ErrorCode::Conflict) return tl::unexpected{at_printer.error()};
  if (auto kept = keep(job, {JournalStep::CancelAsked, who, {}, {}}); !kept) return kept;
  std::string message = fmt::format("by {}", who);
  if (at_printer && *at_printer) {
    const auto place =
        queue_.begun_on(job.id) ? Result<std::optional<std::size_t>>{queue_.begun_on(job.id)} : where_begun(job);
    if (place && *place && machines_.is_whole(**place)) {
      queue_.begin(job.id, **place);
      pass_to_printer(job, fmt::format("cancelled by {}; its printer is asked to stop", who));
      return {};
    }
    message += "; its printer does not stand in this fab any more and may still print it: look at it";
  }
  if (JobPrinter* const printer = printer_of(job.id)) printer->take_off(job.id);
  tracker().end(job.id, JobState::Cancelled, message);
  return {};
}

Result<Job> JobDispatcher::clear_platform(const std::string& machine) {
  const auto place = queue_.find(machine);
  if (!place) {
    std::vector<std::string> names;
    for (const QueuedMachine& each : queue_.machines()) names.push_back(each.name);
    return fail(ErrorCode::NotFound, fmt::format("no machine named {} stands in this fab; {}", machine,
                                                 names_instead(machine, names, "`telefab machines`")));
  }
  const auto there = queue_.part_on(*place);
  const MachineStanding standing = queue_.standing(*place);
  const bool is_in_trouble = standing == MachineStanding::Fault || standing == MachineStanding::Offline;
  if (!there && is_in_trouble) {
    const std::string met_by = shown_[*place].left_by;
    if (met_by.empty()) {  // found out by a look
      printers_[*place]->look();
      Job of_nobody;
      of_nobody.id = machine;
      of_nobody.machine = machine;
      of_nobody.message = "looked for now: telefab machines";
      return of_nobody;
    }
    queue_.forget_trouble(*place);
    shown_[*place] = {};
    dispatch();
    return store().find(met_by);
  }
  if (!there) return fail(ErrorCode::Conflict, fmt::format("the platform of {} is empty already", machine));
  auto occupant = store().find(*there);
  if (occupant && !is_final(occupant->state))
    return fail(ErrorCode::Conflict, fmt::format("job {} is {} on the platform of {}; cancel it first", occupant->id,
                                                 name_of(occupant->state), machine));
  if (auto cleared = empty_platform(*place); !cleared) return tl::unexpected{cleared.error()};
  queue_.set_part(*place, std::nullopt);
  queue_.forget_trouble(*place);
  shown_[*place] = {};
  dispatch();
  if (occupant) return occupant;
  Job forgotten;  // the job list no longer knows it; the platform is empty all the same
  forgotten.id = *there;
  forgotten.machine = machine;
  return forgotten;
}

}  // namespace telefab::fab
