// SPDX-License-Identifier: GPL-3.0-or-later
#include "job_printer.hpp"

#include <fmt/format.h>

#include <telefab/service/log.hpp>

#include "job_room.hpp"
#include "plan_print.hpp"
#include "print_orders.hpp"

namespace telefab::fab {
namespace {

/// What an operator can put right at the site; nothing of the job is lost by it.
bool is_site_trouble(ErrorCode code) {
  return code == ErrorCode::StorageFailed || code == ErrorCode::NotTrusted || code == ErrorCode::Conflict;
}

MachineTrouble trouble_of(const Error& why) {
  if (why.code == ErrorCode::DeviceLost) return MachineTrouble::Lost;
  return is_device_fault(why.code) ? MachineTrouble::Fault : MachineTrouble::None;
}

constexpr auto kRetryEvery = std::chrono::seconds{10};

}  // namespace

JobPrinter::JobPrinter(Site& site, ExposureQuestions& questions, Parts parts)
    : site_{site},
      questions_{questions},
      name_{std::move(parts.name)},
      profile_of_{std::move(parts.profile_of)},
      machine_{std::move(parts.machine)},
      at_start_{parts.at_start},
      events_{std::move(parts.events)} {}

JobPrinter::~JobPrinter() {
  if (queue_) queue_->end();
}

void JobPrinter::begin(const std::string& job) {
  if (is_ending_) return;  // the next start goes on with it
  assigned_ = job;
  if (!queue_)
    queue_.emplace("device", [this](const std::string& each, std::stop_token stop) { print(each, std::move(stop)); });
  queue_->add(job);
}

void JobPrinter::take_off(const std::string& job) {
  if (assigned_ == job) assigned_.clear();
  if (queue_) queue_->drop(job);
}

void JobPrinter::ask_to_end() {
  is_ending_ = true;
  if (queue_) queue_->ask_to_end();
}

void JobPrinter::darken(const std::string& job) {
  if (const auto dark = machine_->go_dark(); !dark)
    log_warning(fmt::format("{}: the light of its print could not be switched off: {}", name_, dark.error().what),
                {job});
}

// ---- the print under way -----------------------------------------------------------------------------------------

void JobPrinter::print(const std::string& job, std::stop_token stop) {
  const auto next = store().find(job);
  if (!next && next.error().code != ErrorCode::NotFound)
    return later([this, job] { add_after(kRetryEvery, job); });  // what cannot be read now may be read in a moment
  if (!next || is_final(next->state)) return;
  if (!has_room(*next)) return;
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
  control->close();                 // words that came too late are kept without it
  if (queue_->is_ending()) return;  // the journal tells the next start where to go on
  later([this, job, record, seconds = std::chrono::duration<double>(site_.clock().now() - began).count()] {
    tracker().set_stage_seconds(job, JobStage::Print, seconds);
    on_ended(job, record);
  });
}

bool JobPrinter::is_recorded_as_printing(const std::string& job) {
  tracker().record(job, JobState::Printing, "");
  const auto now = store().find(job);
  if (now && now->state == JobState::Printing) return true;
  if (!now || !is_final(now->state)) later([this, job] { add_after(kRetryEvery, job); });
  return false;
}

Result<PrintRecord> JobPrinter::attempt(const std::string& job, PrintControl& control, const std::stop_token& stop) {
  const auto found = site_.find(job);
  if (!found) return tl::unexpected{found.error()};
  const auto profile = profile_of_(found->job);
  if (!profile) return tl::unexpected{profile.error()};
  {
    const std::lock_guard lock{mutex_};
    speed_up_ = profile->devices.speed_up;
  }
  PrintTask task{found->folder, *profile, name_, {}};
  task.policy.maybe_exposed = at_start_.maybe_exposed;
  return machine_->print(
      task, control, [&](const PrintProgress& progress) { on_progress(job, progress); }, beats_, stop);
}

bool JobPrinter::has_room(const Job& job) {
  const auto room = site_.room().check(
      print_room_bytes(site_.folder().path() / "jobs" / job.id, LayerIndex{job.counters.print_layers}));
  if (room) return true;
  later([this, id = job.id, why = room.error()] { wait_for_disk(id, {why.code, "the fab is full: " + why.what}); });
  return false;
}

void JobPrinter::add_after(Nanoseconds pause, const std::string& job) {
  site_.loop().after(pause, [this, job] {
    if (assigned_ == job && !is_ending_) queue_->add(job);
  });
}

void JobPrinter::wait_for_disk(const std::string& job, const Error& why) {
  const auto now = store().find(job);
  if (now && is_final(now->state)) return;
  if (now) tracker().wait_for_disk(job, now->state, why);
  add_after(site_.options().retry_every, job);
}

void JobPrinter::on_progress(const std::string& job, const PrintProgress& progress) {
  double seconds_left = std::chrono::duration<double>(progress.left).count();
  {
    const std::lock_guard lock{mutex_};
    seconds_left /= speed_up_;
  }
  later([this, job, progress, seconds_left] {
    const auto now = store().find(job);
    if (!now) return;
    const std::uint32_t printed = progress.layer.count();
    const bool is_live = tracker().counters().change(job, [&](JobCounters& c) {
      if (c.layers_printed != printed)
        log_detail(fmt::format("job {} printed {} of {} layers on {}", job, printed, progress.layers.count(), name_),
                   {job, static_cast<std::int64_t>(printed) - 1});
      c.print_layers = progress.layers.count();
      c.layers_printed = printed;
    });
    if (!is_live) return;
    events_.step({std::string{name_of(progress.phase)}, progress.phase == PrintPhase::Exposing, progress.z_mm,
                  progress.resin_celsius});
    // A fault says in its record whether a layer was perhaps exposed.
    if (progress.phase != PrintPhase::Faulted) questions_.set(job, progress.phase == PrintPhase::AwaitingDecision);
    if (progress.phase == PrintPhase::Done || progress.phase == PrintPhase::Cancelled) return;  // the record follows
    // Stopped with the site, not by a fault of its own: the journal says which, and the next start goes by it.
    if (progress.phase == PrintPhase::Faulted && is_ending_) return;
    const bool waits = progress.phase == PrintPhase::Paused || progress.phase == PrintPhase::AwaitingDecision ||
                       progress.phase == PrintPhase::Faulted;
    if (waits)
      tracker().move(job, JobState::Paused, progress.message);
    else if (now->state != JobState::Printing || now->message != progress.message)
      tracker().move(job, JobState::Printing, "");
    events_.progress(job, waits, seconds_left);
  });
}

bool JobPrinter::is_alive() {
  // Before its first wait the print opens devices and codes every mask, for as long as that takes.
  const std::uint64_t beats = beats_;
  return beat_.is_alive(beats > 0 ? std::optional{beats} : std::nullopt, site_.clock().now());
}

// ---- its end -----------------------------------------------------------------------------------------------------

void JobPrinter::on_ended(const std::string& job, const Result<PrintRecord>& record) {
  PrintEnd end = end_of(job, record);
  if (record)
    leaves_with(job, *record);
  else if (!leaves_without_record(job, record.error(), end))
    return;
  if (assigned_ == job) assigned_.clear();
  events_.ended(job, end);
}

PrintEnd JobPrinter::end_of(const std::string& job, const Result<PrintRecord>& record) {
  if (record) {
    const bool is_fault = record->outcome == PrintOutcome::Faulted;
    const MachineTrouble trouble = is_fault ? trouble_of(record->cause) : MachineTrouble::None;
    // Whatever it broke off by, somebody is to look at the machine.
    return {is_fault && trouble == MachineTrouble::None ? MachineTrouble::Fault : trouble,
            record->layers.empty() && !record->maybe_exposed, record->cause.what};
  }
  PrintEnd end{trouble_of(record.error()), false, record.error().what};
  // Where that cannot be read a part may be there.
  if (const auto found = site_.find(job))
    if (const auto before = start_case(found->folder, found->job))
      end.is_nothing_made = !is_part_begun(*before, found->job);
  return end;
}

bool JobPrinter::leaves_without_record(const std::string& job, const Error& why, PrintEnd& end) {
  if (is_storage_trouble(why)) {
    site_.room().note_trouble(why);
    // Printed to its end, but not recorded: the record needs no operator, only a disk. As long as the disk does not
    // even say whether it is so, nothing is begun.
    const auto ruling = ruling_on(job);
    if (ruling && *ruling == StartRuling::KeepRecord) {
      wait_for_disk(job, why);
      return false;
    }
    if (ruling && *ruling == StartRuling::End) {
      tracker().end(job, JobState::Cancelled, "its record is not kept: " + why.what);
      return true;
    }
    if (!ruling && is_storage_trouble(ruling.error())) {
      if (const auto now = store().find(job)) tracker().wait_for_disk(job, now->state, why);
      site_.loop().after(site_.options().retry_every, [this, job, why] { on_ended(job, fail(why.code, why.what)); });
      return false;
    }
  }
  if (end.trouble == MachineTrouble::Lost && end.is_nothing_made && events_.fits_elsewhere(job)) {
    log_warning(fmt::format("{}: {}; job {} goes to another machine", name_, why.what, job), {job});
    end.goes_elsewhere = true;
    return true;
  }
  if (is_device_fault(why.code) || is_site_trouble(why.code))
    tracker().move(job, JobState::Paused, why.what + "; telefab resume tries again");
  else
    tracker().end(job, JobState::Failed, why.what);
  return true;
}

void JobPrinter::leaves_with(const std::string& job, const PrintRecord& record) {
  tracker().counters().change(job, [&](JobCounters& c) { c.layers_printed = record.next.count(); });
  switch (record.outcome) {
    case PrintOutcome::Done:
      return tracker().end(job, JobState::Done, "");
    case PrintOutcome::Cancelled:
      return tracker().end(job, JobState::Cancelled, fmt::format("at layer {}", record.next.count()));
    case PrintOutcome::Faulted:
      questions_.set(job, record.maybe_exposed);
      return tracker().move(
          job, JobState::Paused,
          fmt::format("faulted at layer {}: {}; {}", record.next.count(), record.cause.what,
                      record.maybe_exposed
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

// ---- words --------------------------------------------------------------------------------------------------------

std::shared_ptr<PrintControl> JobPrinter::control_of(const std::string& job) {
  const std::lock_guard lock{mutex_};
  return printing_ == job ? control_ : nullptr;
}

Result<void> JobPrinter::keep(const Job& job, const PrintWord& word) {
  const auto folder = site_.folder().job(job.id);
  if (!folder) return tl::unexpected{folder.error()};
  const std::lock_guard lock{mutex_};
  if (printing_ == job.id)
    return fail(ErrorCode::Conflict, fmt::format("job {} went on its machine just now; say it again", job.id));
  return keep_word(*folder, job, word, site_.clock().wall());
}

}  // namespace telefab::fab
