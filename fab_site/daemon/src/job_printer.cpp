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

constexpr auto kRetryEvery = std::chrono::seconds{10};
constexpr const char* kLook = "?";  // no job has that name

}  // namespace

JobPrinter::JobPrinter(Site& site, OpenQuestions& questions, Parts parts)
    : site_{site},
      questions_{questions},
      name_{std::move(parts.name)},
      profile_of_{std::move(parts.profile_of)},
      fence_of_{std::move(parts.fence_of)},
      machine_{std::move(parts.machine)},
      at_start_{parts.at_start},
      events_{std::move(parts.events)},
      beat_{machine_->longest_silence()} {}

JobPrinter::~JobPrinter() {
  if (queue_) queue_->end();
}

WorkQueue& JobPrinter::queue() {
  if (!queue_)
    queue_.emplace("device", [this](const std::string& each, std::stop_token stop) {
      if (each == kLook)
        look_now();
      else
        print(each, std::move(stop));
    });
  return *queue_;
}

void JobPrinter::begin(const std::string& job, MayStart may_start) {
  if (is_ending_) return;  // the next start goes on with it
  assigned_ = job;
  {
    const std::lock_guard lock{mutex_};
    may_start_ = may_start;
  }
  queue().add(job);
}

void JobPrinter::look() {
  if (is_ending_ || !assigned_.empty() || machine_->light() == LightOf::Fab) return;
  queue().add(kLook);
}

void JobPrinter::look_now() {
  const auto look = machine_->look();
  if (look)
    later([this, look = *look] {
      if (assigned_.empty() && !is_ending_) events_.looked(look);
    });
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
  Result<PrintReport> report = fail(ErrorCode::Internal, "not begun");
  try {
    report = attempt(job, *control, stop);
  } catch (const std::exception& error) {
    report = fail(ErrorCode::Internal, fmt::format("printing: a fault of Telefab: {}", error.what()));
  }
  {
    const std::lock_guard lock{mutex_};
    printing_.clear();
    control_.reset();
    beats_ = 0;
  }
  control->close();                 // words that came too late are kept without it
  if (queue_->is_ending()) return;  // the journal tells the next start where to go on
  later([this, job, report, seconds = std::chrono::duration<double>(site_.clock().now() - began).count()] {
    tracker().set_stage_seconds(job, JobStage::Print, seconds);
    on_ended(job, report);
  });
}

bool JobPrinter::is_recorded_as_printing(const std::string& job) {
  tracker().record(job, JobState::Printing, "");
  const auto now = store().find(job);
  if (now && now->state == JobState::Printing) return true;
  if (!now || !is_final(now->state)) later([this, job] { add_after(kRetryEvery, job); });
  return false;
}

Result<PrintReport> JobPrinter::attempt(const std::string& job, PrintControl& control, const std::stop_token& stop) {
  const auto found = site_.find(job);
  if (!found) return tl::unexpected{found.error()};
  auto fence = fence_of_(*found);
  if (!fence) return tl::unexpected{fence.error()};
  PrintTask task{found->folder, profile_of_(found->job), name_, {}};
  task.fence = std::move(*fence);
  {
    const std::lock_guard lock{mutex_};
    speed_up_ = task.profile ? task.profile->devices.speed_up : 1;
    task.may_start = may_start_;
  }
  task.policy.maybe_exposed = at_start_.maybe_exposed;
  task.seen = LayerIndex{found->job.counters.layers_printed};
  return machine_->print(
      task, control, [&](const PrintStanding& standing) { on_progress(job, standing); }, beats_, stop);
}

bool JobPrinter::has_room(const Job& job) {
  const auto room = site_.room().check(print_room_bytes(site_.folder().path() / "jobs" / job.id,
                                                        LayerIndex{job.counters.print_layers}, machine_->light()));
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

void JobPrinter::on_progress(const std::string& job, const PrintStanding& standing) {
  double seconds_left = standing.left ? std::chrono::duration<double>(*standing.left).count() : -1;
  {
    const std::lock_guard lock{mutex_};
    if (standing.left) seconds_left /= speed_up_;
  }
  later([this, job, standing, seconds_left] {
    const auto now = store().find(job);
    if (!now) return;
    const std::uint32_t printed = standing.layer.count();
    const bool is_live = tracker().counters().change(job, [&](JobCounters& c) {
      if (c.layers_printed != printed)
        log_detail(fmt::format("job {} printed {} of {} layers on {}", job, printed, standing.layers.count(), name_),
                   {job, static_cast<std::int64_t>(printed) - 1});
      c.print_layers = standing.layers.count();
      c.layers_printed = printed;
    });
    if (!is_live) return;
    // A fault says in its report whether a layer was perhaps exposed.
    if (standing.activity != PrintActivity::Faulted)
      questions_.set(job,
                     standing.activity == PrintActivity::AwaitsDecision ? OpenQuestion::Exposure : OpenQuestion::None);
    if (standing.activity == PrintActivity::Over) return;  // the report follows
    // Stopped with the site, not by a fault of its own: the journal says which, and the next start goes by it.
    if (standing.activity == PrintActivity::Faulted && is_ending_) return;
    const bool waits = standing.activity != PrintActivity::Works;
    const JobState state = waits ? JobState::Paused : JobState::Printing;
    if (waits || now->state != state || now->message != standing.message) tracker().move(job, state, standing.message);
    events_.progress(job, standing, seconds_left);
  });
}

bool JobPrinter::prints() {
  const std::lock_guard lock{mutex_};
  return !printing_.empty();
}

bool JobPrinter::is_alive() {
  // Before its first wait the print opens devices and codes every mask, for as long as that takes.
  const std::uint64_t beats = beats_;
  return beat_.is_alive(beats > 0 ? std::optional{beats} : std::nullopt, site_.clock().now());
}

// ---- its end -----------------------------------------------------------------------------------------------------

void JobPrinter::on_ended(const std::string& job, const Result<PrintReport>& report) {
  PrintEnd end = end_of(job, report);
  if (report)
    leaves_with(job, *report);
  else if (!leaves_without_report(job, report.error(), end))
    return;
  if (assigned_ == job) assigned_.clear();
  events_.ended(job, end);
}

PrintEnd JobPrinter::end_of(const std::string& job, const Result<PrintReport>& report) {
  if (report) return {report->trouble, report->is_nothing_made, report->why, false, report->withheld};
  PrintEnd end{trouble_of(report.error()), false, report.error().what};
  // Where that cannot be read a part may be there.
  if (const auto found = site_.find(job))
    if (const auto before = start_case(found->folder, found->job, machine_->light()))
      end.is_nothing_made = !is_part_begun(*before, found->job);
  return end;
}

bool JobPrinter::leaves_without_report(const std::string& job, const Error& why, PrintEnd& end) {
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
  // A whole printer that was switched off is looked for, and the job waits for it where no other takes it.
  const bool is_looked_for = machine_->light() == LightOf::WholePrinter;
  if (end.trouble == MachineTrouble::Lost && end.is_nothing_made && (events_.fits_elsewhere(job) || is_looked_for)) {
    log_warning(fmt::format("{}: {}; job {} waits for it, or for another machine", name_, why.what, job), {job});
    end.goes_elsewhere = true;
    return true;
  }
  if (is_device_fault(why.code) || is_site_trouble(why.code))
    tracker().move(job, JobState::Paused, why.what + "; telefab resume tries again");
  else
    tracker().end(job, JobState::Failed, why.what);
  return true;
}

void JobPrinter::leaves_with(const std::string& job, const PrintReport& report) {
  tracker().counters().change(job, [&](JobCounters& c) { c.layers_printed = report.next.count(); });
  switch (report.verdict) {
    case PrintVerdict::Done:
      return tracker().end(job, JobState::Done, report.message);
    case PrintVerdict::Cancelled:
      return tracker().end(job, JobState::Cancelled, report.message);
    case PrintVerdict::Failed:
      return tracker().end(job, JobState::Failed, report.message);
    case PrintVerdict::Waits:
      questions_.set(job, report.question);
      // Nobody has to say that it goes on: it does once it has leave.
      if (report.withheld != FenceRefusal::None) return tracker().move(job, JobState::Printing, report.message);
      return tracker().move(job, JobState::Paused, report.message);
  }
}

Result<StartRuling> JobPrinter::ruling_on(const std::string& job) {
  const auto found = site_.find(job);
  if (!found) return tl::unexpected{found.error()};
  const auto before = start_case(found->folder, found->job, machine_->light());
  if (!before) return tl::unexpected{before.error()};
  return may_light_at_start(before->facts, before->has_begun, at_start_, site_.clock().wall()).ruling;
}

// ---- words --------------------------------------------------------------------------------------------------------

std::shared_ptr<PrintControl> JobPrinter::control_of(const std::string& job) {
  const std::lock_guard lock{mutex_};
  return printing_ == job ? control_ : nullptr;
}

Result<StartCase> JobPrinter::case_of(const Job& job) {
  const auto folder = site_.folder().job(job.id);
  if (!folder) return tl::unexpected{folder.error()};
  const std::lock_guard lock{mutex_};
  if (printing_ == job.id)
    return fail(ErrorCode::Conflict, fmt::format("job {} went on its machine just now; say it again", job.id));
  return start_case(*folder, job, machine_->light());
}

Result<void> JobPrinter::keep(const Job& job, const PrintWord& word) {
  const auto folder = site_.folder().job(job.id);
  if (!folder) return tl::unexpected{folder.error()};
  const std::lock_guard lock{mutex_};
  if (printing_ == job.id)
    return fail(ErrorCode::Conflict, fmt::format("job {} went on its machine just now; say it again", job.id));
  auto kept = keep_word(*folder, job, machine_->light(), word, site_.clock().wall());
  // Under the lock: a print that was only to be watched, and begins right now, may start by this word.
  if (kept && (word.step == JournalStep::Approved || word.step == JournalStep::Resumed)) may_start_ = MayStart::Yes;
  return kept;
}

}  // namespace telefab::fab
