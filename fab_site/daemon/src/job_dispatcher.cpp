// SPDX-License-Identifier: GPL-3.0-or-later
#include "job_dispatcher.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <telefab/fab/planning/preflight.hpp>
#include <telefab/service/log.hpp>
#include <telefab/service/saved_message.hpp>

#include "job_room.hpp"
#include "upload.hpp"

namespace telefab::fab {
namespace {

constexpr auto kRetryEvery = std::chrono::seconds{10};
constexpr auto kLookEvery = std::chrono::seconds{10};
/// Whose part is on the platform of a whole printer that prints what no job of the fab is.
constexpr const char* kForeignPart = "a-print-of-its-own";

bool needs_clearing(PlatformPolicy policy, const MachineProfile& machine) {
  if (policy == PlatformPolicy::ByMachine) return makes_parts(machine);
  return policy == PlatformPolicy::ClearedByOperator;
}

std::vector<QueuedMachine> queued(const FabMachines& machines, PlatformPolicy policy) {
  std::vector<QueuedMachine> all;
  for (std::size_t place = 0; place < machines.size(); ++place)
    all.push_back({machines[place].name, needs_clearing(policy, machines.profile(place))});
  return all;
}

MachineState state_of(MachineStanding standing) {
  switch (standing) {
    case MachineStanding::Idle:
      return MachineState::Idle;
    case MachineStanding::Occupied:
      return MachineState::Occupied;
    case MachineStanding::Printing:
      return MachineState::Printing;
    case MachineStanding::Paused:
      return MachineState::Paused;
    case MachineStanding::Fault:
      return MachineState::Fault;
    case MachineStanding::Offline:
      return MachineState::Offline;
  }
  return MachineState::Offline;
}

/// A job that came as a fleet's and of which the book says nothing is lit by nobody.
Result<std::shared_ptr<LightFence>> fence_of(LeaseBook& leases, const FoundJob& found) {
  auto fence = leases.fence_of(found.job.id);
  const auto offer = saved_offer(found.folder);
  if (!fence && offer && offer->attempt > 0)
    return fail(ErrorCode::Conflict,
                fmt::format("it is attempt {} of a fleet's job, and the record of that in the data folder (fleet/) is "
                            "gone, so nobody can say whether it is printed elsewhere; cancel it",
                            offer->attempt));
  return fence;
}

}  // namespace

bool JobDispatcher::may_wait(const Job& job) { return job.state == JobState::Ready || job.state == JobState::Printing; }

JobDispatcher::JobDispatcher(Site& site, const FabSiteConfig& config, FabMachines machines, LeaseBook& leases)
    : site_{site},
      at_start_{config.at_start},
      start_on_approval_{config.start_on_approval},
      machines_{std::move(machines)},
      leases_{leases},
      platforms_{site.folder().path() / "platforms"},
      queue_{queued(machines_, config.platform)},
      shown_(machines_.size()) {
  tracker().on_end([this](const std::string& job) { on_job_end(job); });
  for (std::size_t place = 0; place < machines_.size(); ++place) printers_.push_back(make_printer(place, config));
  read_platforms();
  publish();
  site_.loop().post([this] { look_at_printers(); });  // behind the jobs that go on
}

Result<void> JobDispatcher::empty_platform(std::size_t place) {
  const MachineInstance& at = machines_[place];
  // It had no name of its own before (read_platforms).
  if (at.name != at.profile && machines_.of_profile(at.profile).size() == 1)
    if (auto cleared = platforms_.clear(at.profile); !cleared) return cleared;
  return platforms_.clear(at.name);
}

std::unique_ptr<JobPrinter> JobDispatcher::make_printer(std::size_t place, const FabSiteConfig& config) {
  JobPrinter::Parts parts;
  parts.name = machines_[place].name;
  parts.profile_of = [this, place](const Job& job) { return machines_.profile_on(place, job); };
  parts.fence_of = [this](const FoundJob& found) { return fence_of(leases_, found); };
  parts.machine = printing_machine(machines_.profile(place));
  parts.at_start = config.at_start;
  parts.events = {[this](const std::string& job, const PrintStanding& standing, double seconds_left) {
                    on_progress(job, standing, seconds_left);
                  },
                  [this](const std::string& job) { return fits_elsewhere(job); },
                  [this](const std::string& job, const PrintEnd& end) { on_left(job, end); },
                  [this, place](const MachineLook& look) { on_look(place, look); }};
  return std::make_unique<JobPrinter>(site_, questions_, std::move(parts));
}

void JobDispatcher::read_platforms() {
  for (std::size_t place = 0; place < machines_.size(); ++place) {
    const MachineInstance& machine = machines_[place];
    auto there = platforms_.part_on(machine.name);
    if (there && !*there && machine.name != machine.profile && machines_.of_profile(machine.profile).size() == 1)
      if (const auto before = platforms_.part_on(machine.profile); before && *before)
        there = before;  // it had no name of its own then
    if (there)
      queue_.set_part(place, *there);
    else
      queue_.set_part(place, there.error().what);  // to be taken for occupied
  }
}

JobPrinter* JobDispatcher::printer_of(const std::string& job) {
  const auto place = queue_.machine_of(job);
  return place ? printers_[*place].get() : nullptr;
}

// ---- at a start, and once planned ----------------------------------------------------------------------------------

void JobDispatcher::planned(const std::string& job, const Preflight& preflight) {
  const auto folder = site_.folder().job(job);
  if (start_on_approval_ || preflight.holds() || (folder && waits_for_approval(*folder)))
    return tracker().move(
        job, JobState::AwaitingApproval,
        fmt::format("waits for `telefab approve`{}{}", preflight.holds() ? ": " : "", preflight.why_held()));
  const auto now = store().find(job);
  if (!now || is_final(now->state)) return;
  const auto put = [&]() -> Result<void> {
    if (!folder) return tl::unexpected{folder.error()};
    const auto before = start_case(*folder, *now, light_of(*now));
    if (!before) return tl::unexpected{before.error()};
    // A restored list, or one that was lost: the journal has a print of which the list knows nothing.
    if (before->facts.is_ahead_of_store)
      return fail(ErrorCode::Conflict,
                  "a print of it had begun before, and goes on where its journal ends; look at the platform first");
    tracker().move(job, JobState::Ready, "");
    return let_print(*now, {JournalStep::Approved, kAutomatic, {}, {}});
  }();
  if (put) return;
  if (!is_storage_trouble(put.error()))
    return tracker().move(job, JobState::AwaitingApproval,
                          fmt::format("waits for `telefab approve`: {}", put.error().what));
  tracker().wait_for_disk(job, JobState::Ready, put.error());
  site_.loop().after(site_.options().retry_every, [this, job, preflight] { planned(job, preflight); });
}

Result<std::optional<std::size_t>> JobDispatcher::where_begun(const Job& job) const {
  if (!job.instance.empty()) {
    const auto place = queue_.find(job.instance);
    if (place && job.machine != job.instance && job.machine != machines_[*place].profile)
      return fail(
          ErrorCode::Conflict,
          fmt::format("its print began on {}, and the machine of that name is of {} now, not of {}; name the one "
                      "with the part again in the list of machines and start the fab again, or cancel the job",
                      job.instance, machines_[*place].profile, job.machine));
    if (place) return place;
    // The machine may have got a name of its own since.
    if (const auto only = machines_.of_profile(job.instance); only.size() == 1) return std::optional{only.front()};
    return fail(ErrorCode::Conflict,
                fmt::format("its print began on {}, which does not stand in this fab any more; name it again in the "
                            "list of machines and start the fab again, or cancel the job",
                            job.instance));
  }
  for (std::size_t place = 0; place < machines_.size(); ++place)
    if (queue_.part_on(place) == job.id) return std::optional{place};
  if (const auto place = queue_.find(job.machine)) return place;
  const auto of_profile = machines_.of_profile(job.machine);
  if (of_profile.size() == 1) return std::optional{of_profile.front()};
  return fail(
      ErrorCode::Conflict,
      fmt::format("its print began on {}, and nobody knows which of the machines that is{}; name that one {} in "
                  "the list of machines and start the fab again, or cancel the job",
                  job.machine, of_profile.empty() ? " that stand here" : "", job.machine));
}

Result<void> JobDispatcher::resume(const Job& job) {
  const auto folder = site_.folder().job(job.id);
  if (!folder) return tl::unexpected{folder.error()};
  const auto before = start_case(*folder, job, light_of(job));
  if (!before) return tl::unexpected{before.error()};
  const StartVerdict verdict = may_light_at_start(before->facts, before->has_begun, at_start_, site_.clock().wall());
  std::optional<std::size_t> place;
  if (is_part_begun(*before, job) && verdict.ruling != StartRuling::End) {
    const auto found = where_begun(job);
    if (!found) {
      questions_.set(job.id, before->question());
      return tl::unexpected{found.error()};
    }
    place = *found;
    queue_.begin(job.id, *place);
    if (auto kept = store().set_instance(job.id, machines_[*place].name); !kept)
      log_warning(kept.error().what, {job.id});  // the platform says so too
  } else if (!job.instance.empty()) {
    place = queue_.find(job.instance);
  }
  follow(job, *before, verdict);
  if (before->has_begun && verdict.ruling != StartRuling::GoOn) {
    if (!place) place = queue_.find(job.machine);
    if (place) printers_[*place]->darken(job.id);  // else its light is no longer this site's
  }
  publish();
  return {};
}

void JobDispatcher::follow(const Job& job, const StartCase& before, const StartVerdict& verdict) {
  const std::string why = fab::sentence_of(verdict);
  switch (verdict.ruling) {
    case StartRuling::GoOn:
      return wait_for_machine(job.id);  // its journal knows how far it came
    case StartRuling::KeepRecord:       // whatever the machine has become
      queue_.add(job.id, {});
      return dispatch_soon();
    case StartRuling::End:
      return tracker().end(job.id, JobState::Cancelled, fmt::format("by {}", before.facts.order.by));
    case StartRuling::WaitForApproval:
      if (job.state != JobState::AwaitingApproval)
        tracker().move(job.id, JobState::AwaitingApproval, fmt::format("waits for `telefab approve`: {}", why));
      return;
    case StartRuling::Watch:
      return watch(job.id);
    case StartRuling::WaitForResume:
      if (!before.point.maybe_exposed)
        return tracker().move(job.id, JobState::Paused, fmt::format("waits for `telefab resume`: {}", why));
      [[fallthrough]];
    case StartRuling::WaitForDecision:
      questions_.set(job.id, before.question());
      return tracker().move(
          job.id, JobState::Paused,
          fmt::format("{}; {}", why,
                      before.question() == OpenQuestion::Start ? question_about_start(job.id)
                                                               : fab::question_about(before.point, job.id)));
  }
}

void JobDispatcher::watch(const std::string& job) {
  only_watched_.insert(job);
  wait_for_machine(job, InTrouble::Tries);
}

// ---- whole printers ------------------------------------------------------------------------------------------------

LightOf JobDispatcher::light_of(const Job& job) const {
  const auto place = job.instance.empty() ? std::optional<std::size_t>{} : queue_.find(job.instance);
  return place && machines_.is_whole(*place) ? LightOf::WholePrinter : LightOf::Fab;
}

void JobDispatcher::look_at_printers() {
  bool is_any = false;
  for (std::size_t place = 0; place < machines_.size(); ++place)
    if (machines_.is_whole(place)) {
      is_any = true;
      printers_[place]->look();
    }
  if (is_any && !is_ending_) site_.loop().after(kLookEvery, [this] { look_at_printers(); });
}

void JobDispatcher::on_look(std::size_t place, const MachineLook& look) {
  if (const auto job = queue_.job_of(place); job && queue_.machine_of(*job)) return;  // it got one meanwhile
  const MachineStanding before = queue_.standing(place);
  queue_.set_found(place, look.is_found);
  const MachineStanding now = queue_.standing(place);
  if (now == MachineStanding::Offline && before != now) shown_[place] = {-1, look.why};
  if (now != MachineStanding::Offline && before == MachineStanding::Offline) shown_[place] = {};
  // Whoever started that has a part on the platform.
  if (!look.foreign.empty() && !queue_.part_on(place)) {
    if (auto kept = platforms_.occupy(machines_[place].name, kForeignPart); !kept) log_warning(kept.error().what);
    queue_.set_part(place, kForeignPart);
  }
  if (queue_.part_on(place) == kForeignPart)
    shown_[place].why = look.foreign.empty() ? "" : fmt::format("prints {}, not a job of this fab", look.foreign);
  if (before != now || !look.foreign.empty())
    log_detail(fmt::format("{} is {}", machines_[place].name, name_of(state_of(now))), {});
  if (now != before) return dispatch();
  publish();
}

// ---- which job on which machine ------------------------------------------------------------------------------------

bool JobDispatcher::fits_elsewhere(const std::string& job) {
  const auto now = store().find(job);
  const auto here = queue_.machine_of(job);
  if (!now || !here) return false;
  const auto fits = this->fits(*now);
  return std::ranges::any_of(fits.places, [&](std::size_t place) {
    const MachineStanding at = queue_.standing(place);
    return place != *here && at != MachineStanding::Offline && at != MachineStanding::Fault;
  });
}

void JobDispatcher::wait_for_machine(const std::string& job, InTrouble in_trouble) {
  const auto now = store().find(job);
  if (!now) return log_warning(now.error().what, {job});
  if (!has_leave(*now)) return;
  const auto fits = this->fits(*now);
  const auto begun = queue_.begun_on(job);
  const bool is_misfit = begun && std::ranges::find(fits.places, *begun) == fits.places.end();
  // What goes on at its printer is watched there, and obeys, whatever that has become.
  if (is_misfit && machines_.is_whole(*begun) && is_at_printer(*now).value_or(false)) only_watched_.insert(job);
  if (is_misfit && !only_watched_.contains(job))
    return tracker().move(job, JobState::Paused,
                          fmt::format("its print began on {}, which has another resin or light now; put that back in "
                                      "the list and start the fab again, or cancel the job",
                                      machines_[*begun].name));
  // Nothing that happens to a machine would end its wait: somebody is to change the fab, and to say so.
  if (fits.places.empty() && !begun)
    return tracker().move(job, JobState::Paused, fits.why_none + "; telefab resume tries again");
  queue_.add(job, fits.places, in_trouble);
  dispatch_soon();
}

void JobDispatcher::dispatch() {
  if (is_ending_) return;
  for (const Assignment& each : queue_.assign()) put_on(each);
  explain_waits();
  publish();
}

void JobDispatcher::dispatch_soon() {
  if (std::exchange(is_dispatch_due_, true)) return;
  site_.loop().post([this] {
    is_dispatch_due_ = false;
    dispatch();
  });
}

Result<void> JobDispatcher::record_place(const Assignment& assignment) {
  const std::string& machine = machines_[assignment.machine].name;
  if (queue_.part_on(assignment.machine) != assignment.job)
    if (auto taken = platforms_.occupy(machine, assignment.job); !taken) return taken;
  queue_.set_part(assignment.machine, assignment.job);
  return store().set_instance(assignment.job, machine);
}

void JobDispatcher::put_on(const Assignment& assignment) {
  if (auto placed = record_place(assignment); !placed) {
    log_warning(placed.error().what, {assignment.job});
    site_.room().note_trouble(placed.error());
    queue_.release(assignment.job, MachineTrouble::None);
    site_.loop().after(kRetryEvery, [this, job = assignment.job] {
      const auto now = store().find(job);
      if ((now && may_wait(*now)) || (!now && now.error().code != ErrorCode::NotFound)) wait_for_machine(job);
    });
    return;
  }
  explained_.erase(assignment.job);
  shown_[assignment.machine] = {};
  queue_.begin(assignment.job, assignment.machine);
  if (const auto now = store().find(assignment.job); now && now->state == JobState::Ready && !now->message.empty())
    tracker().move(assignment.job, JobState::Ready, "");  // what it waited for is there
  printers_[assignment.machine]->begin(assignment.job,
                                       only_watched_.contains(assignment.job) ? MayStart::No : MayStart::Yes);
}

std::string JobDispatcher::sentence_of(const Wait& wait) const {
  const std::string machine = wait.machine ? machines_[*wait.machine].name : std::string{};
  switch (wait.reason) {
    case WaitReason::Busy:
      return {};
    case WaitReason::Platform:
      return fmt::format("waits for an empty platform: {} is on that of {}; take it off, then telefab cleared {}",
                         queue_.part_on(*wait.machine) == kForeignPart
                             ? "what it printed by itself"
                             : fmt::format("the part of {}", queue_.part_on(*wait.machine).value_or("")),
                         machine, machine);
    case WaitReason::Held:
    case WaitReason::Trouble:
      return fmt::format(
          "waits for {}, which is {}: {}", machine, name_of(state_of(queue_.standing(*wait.machine))),
          wait.reason == WaitReason::Held
              ? fmt::format("job {} began there", queue_.job_of(*wait.machine).value_or(""))
              : fmt::format("{}; {}telefab cleared {} has it tried again", shown_[*wait.machine].why,
                            shown_[*wait.machine].left_by.empty() ? "it is looked for by itself, and " : "", machine));
    case WaitReason::NoMachine:
      break;
  }
  return "waits for a machine: none fits";
}

void JobDispatcher::explain_waits() {
  std::map<std::string, std::string> for_platform;
  for (const std::string& job : queue_.waiting()) {
    const Wait wait = *queue_.wait_of(job);
    if (wait.reason == WaitReason::Platform) for_platform[job] = machines_[*wait.machine].name;
    std::string why = sentence_of(wait);
    const auto before = explained_.find(job);
    if (before != explained_.end() && before->second == why) continue;
    explained_[job] = why;
    const auto now = store().find(job);
    if (!now || !may_wait(*now)) continue;
    if (why.empty() && now->state == JobState::Printing) why = "waits for its machine";
    if (why != now->message) tracker().move(job, now->state, why);
  }
  const std::lock_guard lock{mutex_};
  for_platform_ = std::move(for_platform);
}

void JobDispatcher::on_progress(const std::string& job, const PrintStanding& standing, double seconds_left) {
  const auto place = queue_.machine_of(job);
  if (!place) return;
  queue_.set_paused(job, standing.activity != PrintActivity::Works);
  queue_.set_lost(job, standing.is_lost);
  shown_[*place].seconds_left = seconds_left;
  shown_[*place].now = standing.now;
  publish();
}

void JobDispatcher::on_left(const std::string& job, const PrintEnd& end) {
  // The job may have ended, and be off its machine for that already; where it was says the list.
  auto place = queue_.machine_of(job);
  if (const auto now = store().find(job); !place && now) place = queue_.find(now->instance);
  queue_.release(job, end.trouble);
  if (place) {
    shown_[*place] = end.trouble == MachineTrouble::None ? Shown{} : Shown{-1, end.why, job, {}, false};
    if (end.is_nothing_made && queue_.part_on(*place) == job) {
      if (auto cleared = empty_platform(*place); !cleared) log_warning(cleared.error().what, {job});
      queue_.set_part(*place, std::nullopt);
    }
  }
  if (end.is_nothing_made) queue_.forget_begun(job);
  if (end.withheld != FenceRefusal::None) {
    dispatch();
    return wait_for_leave(job);
  }
  if (end.goes_elsewhere) return wait_for_machine(job);
  dispatch();
}

void JobDispatcher::on_job_end(const std::string& job) {
  questions_.set(job, OpenQuestion::None);
  queue_.end(job);
  explained_.erase(job);
  only_watched_.erase(job);
  for_lease_.erase(job);
  dispatch_soon();
}

// ---- what is shown -------------------------------------------------------------------------------------------------

void JobDispatcher::publish() {
  std::vector<MachineStatus> all;
  for (std::size_t place = 0; place < machines_.size(); ++place) {
    const MachineInstance& machine = machines_[place];
    MachineStatus status;
    status.name = machine.name;
    status.profile = machine.profile;
    status.state = state_of(queue_.standing(place));
    status.resin =
        machines_.composed(place).resin.empty() ? machines_.profile(place).resin.name : machines_.composed(place).resin;
    status.job = queue_.job_of(place).value_or("");
    status.seconds_left = shown_[place].seconds_left;
    status.waiting = static_cast<std::uint32_t>(queue_.waiting_for(place));
    status.message = shown_[place].why;
    status.is_stated = machine.is_stated;
    all.push_back(std::move(status));
  }
  std::map<std::string, MachineMoment, std::less<>> moments;
  for (std::size_t place = 0; place < machines_.size(); ++place)
    if (shown_[place].now && queue_.job_of(place)) moments.emplace(machines_[place].name, *shown_[place].now);
  const std::lock_guard lock{mutex_};
  if (all == published_ && moments == moments_) return;
  published_ = std::move(all);
  moments_ = std::move(moments);
  ++revision_;
}

std::optional<MachineMoment> JobDispatcher::moment(std::string_view machine) {
  const std::lock_guard lock{mutex_};
  const auto found = moments_.find(machine);
  return found == moments_.end() ? std::nullopt : std::optional{found->second};
}

std::vector<MachineStatus> JobDispatcher::standing() {
  std::vector<MachineStatus> all;
  {
    const std::lock_guard lock{mutex_};
    all = published_;
  }
  for (MachineStatus& status : all) {
    const auto job = status.job.empty() ? Result<Job>{fail(ErrorCode::NotFound, "")} : store().find(status.job);
    if (!job) {
      // A platform that cannot be read is nobody's, and neither is what a printer makes by itself.
      if (!is_job_id(status.job) || status.job == kForeignPart) status.job.clear();
      if (status.state == MachineState::Occupied && status.message.empty())
        status.message = fmt::format("take the part off, then telefab cleared {}", status.name);
      continue;
    }
    status.job_name = job->name;
    status.layer = job->counters.layers_printed;
    status.layers = job->counters.print_layers;
    const bool waits = status.state == MachineState::Paused || status.state == MachineState::Fault ||
                       status.state == MachineState::Offline;
    if (waits && !job->message.empty()) status.message = job->message;
    if (status.state == MachineState::Occupied)
      status.message = fmt::format("take the part off, then telefab cleared {}", status.name);
  }
  return all;
}

std::string JobDispatcher::platform_waited_for(const std::string& job) {
  const std::lock_guard lock{mutex_};
  const auto found = for_platform_.find(job);
  return found == for_platform_.end() ? std::string{} : found->second;
}

// ---- the service ---------------------------------------------------------------------------------------------------

bool JobDispatcher::is_alive() {
  bool has_hung = false, has_living = false;
  for (std::size_t place = 0; place < printers_.size(); ++place) {
    const bool is_alive = printers_[place]->is_alive();  // each is asked: it compares with the question before
    if (!printers_[place]->prints()) continue;
    (is_alive ? has_living : has_hung) = true;
    if (is_alive == !shown_[place].has_hung) continue;
    shown_[place].has_hung = !is_alive;
    shown_[place].why = is_alive ? ""
                        : machines_.is_whole(place)
                            ? "the print no longer looks at its printer, which goes on by itself"
                            : "the print no longer looks at its devices; its light ends by itself";
    if (!is_alive) log_warning(fmt::format("{}: {}", machines_[place].name, shown_[place].why));
    publish();
  }
  // The service manager would end every print for one that hangs; those that go on come first.
  return !has_hung || has_living;
}

void JobDispatcher::ask_to_end() {
  is_ending_ = true;
  for (const auto& printer : printers_) printer->ask_to_end();
}

bool JobDispatcher::is_idle() const {
  return std::ranges::none_of(printers_, [](const auto& printer) { return printer->prints(); });
}

bool JobDispatcher::has_ended() const {
  return std::ranges::all_of(printers_, [](const auto& printer) { return printer->has_ended(); });
}

}  // namespace telefab::fab
