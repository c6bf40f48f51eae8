// SPDX-License-Identifier: GPL-3.0-or-later
#include "job_printer.hpp"

#include <fmt/format.h>

#include <telefab/fab/planning/preflight.hpp>
#include <telefab/service/log.hpp>
#include <telefab/service/profile_choice.hpp>

#include "job_room.hpp"
#include "upload.hpp"

namespace telefab::fab {
namespace {

/// What an operator can put right at the site; nothing of the job is lost by it.
bool is_site_trouble(ErrorCode code) {
  return code == ErrorCode::StorageFailed || code == ErrorCode::NotTrusted || code == ErrorCode::Conflict;
}

constexpr auto kRetryEvery = std::chrono::seconds{10};

}  // namespace

JobPrinter::JobPrinter(Site& site, const FabSiteConfig& config)
    : site_{site},
      at_start_{config.at_start},
      platform_policy_{config.platform},
      start_on_approval_{config.start_on_approval},
      platforms_{site.folder().path() / "platforms"},
      queue_{"device", [this](const std::string& job, std::stop_token stop) { print(job, std::move(stop)); }} {
  tracker().on_end([this](const std::string& job) { set_exposure_unknown(job, false); });
}

JobPrinter::~JobPrinter() { queue_.end(); }

void JobPrinter::planned(const std::string& job, const Preflight& preflight) {
  const auto folder = site_.folder().job(job);
  if (start_on_approval_ || preflight.holds() || (folder && waits_for_approval(*folder)))
    return tracker().move(
        job, JobState::AwaitingApproval,
        fmt::format("waits for `telefab approve`{}{}", preflight.holds() ? ": " : "", preflight.why_held()));
  const auto now = store().find(job);
  if (!now || is_final(now->state)) return;
  const auto put = [&]() -> Result<void> {
    if (!folder) return tl::unexpected{folder.error()};
    const auto before = start_case(*folder, *now);
    if (!before) return tl::unexpected{before.error()};
    // A restored list, or one that was lost: the journal has a print of which the list knows nothing.
    if (before->facts.is_ahead_of_store)
      return fail(ErrorCode::Conflict,
                  "a print of it had begun before, and goes on where its journal ends; look at the platform first");
    tracker().move(job, JobState::Ready, "");
    return put_on_machine(*now, {JournalStep::Approved, kAutomatic, {}, {}});
  }();
  if (put) return;
  if (!is_storage_trouble(put.error()))
    return tracker().move(job, JobState::AwaitingApproval,
                          fmt::format("waits for `telefab approve`: {}", put.error().what));
  tracker().wait_for_disk(job, JobState::Ready, put.error());
  site_.loop().after(site_.options().retry_every, [this, job, preflight] { planned(job, preflight); });
}

Result<void> JobPrinter::resume(const Job& job) {
  const auto folder = site_.folder().job(job.id);
  if (!folder) return tl::unexpected{folder.error()};
  const auto before = start_case(*folder, job);
  if (!before) return tl::unexpected{before.error()};
  const StartVerdict verdict = may_light_at_start(before->facts, before->has_begun, at_start_, site_.clock().wall());
  const std::string why = sentence_of(verdict);
  switch (verdict.ruling) {
    case StartRuling::GoOn:
    case StartRuling::KeepRecord:
      queue_.add(job.id);  // its journal knows how far it came
      break;
    case StartRuling::End:
      tracker().end(job.id, JobState::Cancelled, fmt::format("by {}", before->facts.order.by));
      break;
    case StartRuling::WaitForApproval:
      if (job.state != JobState::AwaitingApproval)
        tracker().move(job.id, JobState::AwaitingApproval, fmt::format("waits for `telefab approve`: {}", why));
      break;
    case StartRuling::WaitForResume:
      if (!before->point.maybe_exposed) {
        tracker().move(job.id, JobState::Paused, fmt::format("waits for `telefab resume`: {}", why));
        break;
      }
      [[fallthrough]];
    case StartRuling::WaitForDecision:
      set_exposure_unknown(job.id, true);
      tracker().move(job.id, JobState::Paused, fmt::format("{}; {}", why, question_about(before->point, job.id)));
      break;
  }
  if (before->has_begun && verdict.ruling != StartRuling::GoOn) darken(job);
  return {};
}

void JobPrinter::darken(const Job& job) {
  const auto machine = find_machine(site_.machines(), job.machine);
  if (!machine) return;  // its light is no longer this site's
  if (const auto dark = go_dark(*machine); !dark)
    log_warning(
        fmt::format("{}: the light of its print could not be switched off: {}", machine->name, dark.error().what),
        {job.id});
}

// ---- the print under way -----------------------------------------------------------------------------------------

void JobPrinter::print(const std::string& job, std::stop_token stop) {
  const auto next = store().find(job);
  if (!next || is_final(next->state)) return;
  if (!has_room(*next)) return;
  if (const auto known = find_machine(site_.machines(), next->machine); known && !take_platform(*next, *known)) return;
  if (!is_recorded_as_printing(job)) return;
  const auto control = std::make_shared<PrintControl>();
  {
    const std::lock_guard lock{mutex_};
    printing_ = job;
    control_ = control;
  }
  const Nanoseconds began = site_.clock().now();
  Result<PrintRecord> record = fail(ErrorCode::Internal, "not begun");
  try {
    record = attempt(job, *control, stop);
  } catch (const std::exception& error) {
    record = fail(ErrorCode::Internal, fmt::format("printing: a fault of Telefab: {}", error.what()));
  }
  {
    const std::lock_guard lock{mutex_};
    printing_.clear();
    control_.reset();
    beats_ = 0;
  }
  control->close();                // words that came too late are kept without it
  if (queue_.is_ending()) return;  // the journal tells the next start where to go on
  later([this, job, record, seconds = std::chrono::duration<double>(site_.clock().now() - began).count()] {
    tracker().set_stage_seconds(job, JobStage::Print, seconds);
    on_ended(job, record);
  });
}

bool JobPrinter::is_recorded_as_printing(const std::string& job) {
  tracker().record(job, JobState::Printing, "");
  const auto now = store().find(job);
  if (now && now->state == JobState::Printing) return true;
  if (!now || !is_final(now->state)) try_again_later(job);
  return false;
}

void JobPrinter::try_again_later(const std::string& job) {
  later([this, job] { site_.loop().after(kRetryEvery, [this, job] { queue_.add(job); }); });
}

Result<PrintRecord> JobPrinter::attempt(const std::string& job, PrintControl& control, const std::stop_token& stop) {
  const auto found = site_.find(job);
  if (!found) return tl::unexpected{found.error()};
  const auto machine = profile_of_job(site_.profiles(), found->job.machine, found->job.parameters);
  if (!machine) return tl::unexpected{machine.error()};
  PrintPolicy policy;
  policy.maybe_exposed = at_start_.maybe_exposed;
  return print_from(
      found->folder, *machine, policy, control, [&](const PrintProgress& progress) { on_progress(job, progress); },
      beats_, stop);
}

void JobPrinter::on_ended(const std::string& job, const Result<PrintRecord>& record) {
  if (!record && is_storage_trouble(record.error())) {
    site_.room().note_trouble(record.error());
    // Printed to its end, but not recorded: the record needs no operator, only a disk. As long as the disk does not
    // even say whether it is so, nothing is begun.
    const auto ruling = ruling_on(job);
    if (ruling && *ruling == StartRuling::KeepRecord) return wait_for_disk(job, record.error());
    if (ruling && *ruling == StartRuling::End)
      return tracker().end(job, JobState::Cancelled, "its record is not kept: " + record.error().what);
    if (!ruling && is_storage_trouble(ruling.error())) {
      if (const auto now = store().find(job)) tracker().wait_for_disk(job, now->state, record.error());
      return site_.loop().after(site_.options().retry_every, [this, job, record] { on_ended(job, record); });
    }
  }
  if (!record && (is_device_fault(record.error().code) || is_site_trouble(record.error().code)))
    return tracker().move(job, JobState::Paused, record.error().what + "; telefab resume tries again");
  if (!record) return tracker().end(job, JobState::Failed, record.error().what);
  // Nothing was made: the platform is as empty as before.
  if (const auto ended = store().find(job); ended && record->layers.empty() && record->outcome != PrintOutcome::Faulted)
    if (auto cleared = platforms_.clear(ended->machine); !cleared) log_warning(cleared.error().what, {job});
  tracker().counters().change(job, [&](JobCounters& c) { c.layers_printed = record->next.count(); });
  switch (record->outcome) {
    case PrintOutcome::Done:
      return tracker().end(job, JobState::Done, "");
    case PrintOutcome::Cancelled:
      return tracker().end(job, JobState::Cancelled, fmt::format("at layer {}", record->next.count()));
    case PrintOutcome::Faulted:
      set_exposure_unknown(job, record->maybe_exposed);
      return tracker().move(
          job, JobState::Paused,
          fmt::format("faulted at layer {}: {}; {}", record->next.count(), record->cause.what,
                      record->maybe_exposed
                          ? "the layer was perhaps exposed: telefab resume --as treat-as-exposed|expose-again"
                          : "telefab resume tries again"));
  }
}

Result<StartRuling> JobPrinter::ruling_on(const std::string& job) {
  const auto found = site_.find(job);
  if (!found) return tl::unexpected{found.error()};
  const auto before = start_case(found->folder, found->job);
  if (!before) return tl::unexpected{before.error()};
  return may_light_at_start(before->facts, before->has_begun, at_start_, site_.clock().wall()).ruling;
}

void JobPrinter::on_progress(const std::string& job, const PrintProgress& progress) {
  later([this, job, progress] {
    const auto now = store().find(job);
    if (!now) return;
    const std::uint32_t printed = progress.layer.count();
    const bool is_live = tracker().counters().change(job, [&](JobCounters& c) {
      if (c.layers_printed != printed)
        log_detail(fmt::format("job {} printed {} of {} layers", job, printed, progress.layers.count()),
                   {job, static_cast<std::int64_t>(printed) - 1});
      c.print_layers = progress.layers.count();
      c.layers_printed = printed;
    });
    if (!is_live) return;
    // A fault says in its record whether a layer was perhaps exposed.
    if (progress.phase != PrintPhase::Faulted)
      set_exposure_unknown(job, progress.phase == PrintPhase::AwaitingDecision);
    if (progress.phase == PrintPhase::Done || progress.phase == PrintPhase::Cancelled) return;  // the record follows
    // Stopped with the site, not by a fault of its own: the journal says which, and the next start goes by it.
    if (progress.phase == PrintPhase::Faulted && queue_.is_ending()) return;
    const bool waits = progress.phase == PrintPhase::Paused || progress.phase == PrintPhase::AwaitingDecision ||
                       progress.phase == PrintPhase::Faulted;
    if (waits)
      tracker().move(job, JobState::Paused, progress.message);
    else if (now->state != JobState::Printing || now->message != progress.message)
      tracker().move(job, JobState::Printing, "");
  });
}

bool JobPrinter::is_alive() {
  // Before its first wait the print opens devices and codes every mask, for as long as that takes.
  const std::uint64_t beats = beats_;
  return beat_.is_alive(beats > 0 ? std::optional{beats} : std::nullopt, site_.clock().now());
}

// ---- commands ---------------------------------------------------------------------------------------------------

std::shared_ptr<PrintControl> JobPrinter::control_of(const std::string& job) {
  const std::lock_guard lock{mutex_};
  return printing_ == job ? control_ : nullptr;
}

void JobPrinter::command(const Job& job, const Command& command, std::function<void(Result<Job>)> done) {
  const auto refuse = [&](std::string_view why) {
    done(fail(ErrorCode::Conflict, fmt::format("job {} is {}: {}", job.id, name_of(job.state), why)));
  };
  if (is_final(job.state)) return refuse("it has ended");
  const std::shared_ptr<PrintControl> control = control_of(job.id);
  const auto answer = [&](const Result<void>& outcome) {
    if (outcome)
      done(store().find(job.id));
    else
      done(tl::unexpected{outcome.error()});
  };
  std::optional<Decision> decision;
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
      if (control && !is_exposure_unknown(job.id))
        return refuse("no layer of it was perhaps exposed; resume it without saying what the layer was");
      decision = command.command == JobCommand::ExposeAgain ? Decision::ExposeAgain : Decision::TreatAsExposed;
      [[fallthrough]];
    case JobCommand::Resume:
      if (job.state != JobState::Paused) return refuse("it is not paused");
      if (control) return pass_to_print(command, control, std::move(done));
      return answer(put_on_machine(job, {JournalStep::Resumed, command.who, {}, decision}));
    case JobCommand::Cancel:
      if (control) return pass_to_print(command, control, std::move(done));
      return answer(cancel(job, command.who));
    case JobCommand::Cleared:
    case JobCommand::Forget:
      break;  // about a machine, or a job that has ended: the site's
  }
}

// ---- room on disk ----------------------------------------------------------------------------------------------

bool JobPrinter::has_room(const Job& job) {
  const auto room = site_.room().check(
      print_room_bytes(site_.folder().path() / "jobs" / job.id, LayerIndex{job.counters.print_layers}));
  if (room) return true;
  later([this, id = job.id, why = room.error()] { wait_for_disk(id, {why.code, "the fab is full: " + why.what}); });
  return false;
}

void JobPrinter::wait_for_disk(const std::string& job, const Error& why) {
  const auto now = store().find(job);
  if (now && is_final(now->state)) return;
  if (now) tracker().wait_for_disk(job, now->state, why);
  site_.loop().after(site_.options().retry_every, [this, job] { queue_.add(job); });
}

// ---- the platform ----------------------------------------------------------------------------------------------

bool JobPrinter::take_platform(const Job& job, const MachineProfile& machine) {
  const auto there = platforms_.part_on(machine.name);
  const bool is_own = there && *there == job.id;
  const bool is_free = there && !*there;
  if (is_own) return true;
  if (needs_clearing(platform_policy_, machine) && !is_free) {
    const std::string occupant = there ? **there : there.error().what;
    later([this, job, occupant] { wait_for_platform(job, occupant); });
    return false;
  }
  if (auto taken = platforms_.occupy(machine.name, job.id); !taken) {
    log_warning(taken.error().what, {job.id});
    try_again_later(job.id);
    return false;
  }
  return true;
}

void JobPrinter::wait_for_platform(const Job& job, const std::string& occupant) {
  const auto now = store().find(job.id);
  if (!now || is_final(now->state)) return;
  {
    const std::lock_guard lock{mutex_};
    for_platform_.insert(job.id);
  }
  tracker().move(
      job.id, now->state,
      fmt::format("waits for an empty platform: the part of {} is on that of {}; take it off, then telefab cleared {}",
                  occupant, job.machine, job.machine));
}

Result<Job> JobPrinter::clear_platform(const std::string& machine) {
  if (const auto known = find_machine(site_.machines(), machine); !known)
    return fail(ErrorCode::NotFound, known.error().what);
  const auto there = platforms_.part_on(machine);
  if (!there) return tl::unexpected{there.error()};
  if (!*there) return fail(ErrorCode::Conflict, fmt::format("the platform of {} is empty already", machine));
  auto occupant = store().find(**there);
  if (occupant && !is_final(occupant->state))
    return fail(ErrorCode::Conflict, fmt::format("job {} is {} on the platform of {}; cancel it first", occupant->id,
                                                 name_of(occupant->state), machine));
  if (auto cleared = platforms_.clear(machine); !cleared) return tl::unexpected{cleared.error()};
  std::set<std::string> waiting;
  {
    const std::lock_guard lock{mutex_};
    waiting.swap(for_platform_);
  }
  for (const std::string& id : waiting) queue_.add(id);  // those of other machines wait again
  if (occupant) return occupant;
  Job forgotten;  // the job list no longer knows it; the platform is empty all the same
  forgotten.id = **there;
  forgotten.machine = machine;
  return forgotten;
}

bool JobPrinter::waits_for_platform(const std::string& job) {
  const std::lock_guard lock{mutex_};
  return for_platform_.contains(job);
}

void JobPrinter::pass_to_print(const Command& command, const std::shared_ptr<PrintControl>& control,
                               std::function<void(Result<Job>)> done) {
  // Answered on the network thread once the journal has the word; a print that ended meanwhile hands it back.
  const WordKept kept = [this, command, done = std::move(done)](const std::optional<Result<void>>& outcome) {
    later([this, command, done, outcome] {
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

Result<void> JobPrinter::keep(const Job& job, const PrintWord& word) {
  const auto folder = site_.folder().job(job.id);
  if (!folder) return tl::unexpected{folder.error()};
  const std::lock_guard lock{mutex_};
  if (printing_ == job.id)
    return fail(ErrorCode::Conflict, fmt::format("job {} went on its machine just now; say it again", job.id));
  return keep_word(*folder, job, word, site_.clock().wall());
}

Result<void> JobPrinter::put_on_machine(const Job& job, const PrintWord& word) {
  if (auto kept = keep(job, word); !kept) return kept;
  set_exposure_unknown(job.id, false);
  if (job.state == JobState::AwaitingApproval || job.state == JobState::Ready)
    tracker().move(job.id, JobState::Ready, "");
  // Before the answer: a start whose list still says paused would wait for the word again.
  if (job.state == JobState::Paused) tracker().move(job.id, JobState::Printing, "waits for its machine");
  queue_.add(job.id);
  return {};
}

Result<void> JobPrinter::approve(const Job& job, const Command& command) {
  const auto folder = site_.folder().job(job.id);
  if (!folder) return tl::unexpected{folder.error()};
  const auto preflight = preflight_in(*folder / "plan");
  if (!preflight) return tl::unexpected{preflight.error()};
  const auto why = let_through(*preflight, command.although);
  if (!why) return fail_in(fmt::format("job {}", job.id), why.error());
  return put_on_machine(job, {JournalStep::Approved, command.who, *why, {}});
}

Result<void> JobPrinter::pause(const Job& job, const std::string& who) {
  if (auto kept = keep(job, {JournalStep::PauseAsked, who, {}, {}}); !kept) return kept;
  queue_.drop(job.id);
  tracker().move(job.id, JobState::Paused, "");
  return {};
}

Result<void> JobPrinter::cancel(const Job& job, const std::string& who) {
  if (auto kept = keep(job, {JournalStep::CancelAsked, who, {}, {}}); !kept) return kept;
  queue_.drop(job.id);
  {
    const std::lock_guard lock{mutex_};
    for_platform_.erase(job.id);
  }
  tracker().end(job.id, JobState::Cancelled, fmt::format("by {}", who));
  return {};
}

bool JobPrinter::is_exposure_unknown(const std::string& job) {
  const std::lock_guard lock{mutex_};
  return exposure_unknown_.contains(job);
}

void JobPrinter::set_exposure_unknown(const std::string& job, bool is_unknown) {
  const std::lock_guard lock{mutex_};
  if (is_unknown)
    exposure_unknown_.insert(job);
  else
    exposure_unknown_.erase(job);
}

}  // namespace telefab::fab
