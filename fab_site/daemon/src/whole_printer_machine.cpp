// SPDX-License-Identifier: GPL-3.0-or-later
#include "whole_printer_machine.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <telefab/base/file.hpp>
#include <telefab/base/file_md5.hpp>
#include <telefab/fab/drivers/choose_printer.hpp>
#include <telefab/fab/formats/whole_print_file.hpp>
#include <telefab/fab/planning/plan_folder.hpp>
#include <telefab/fab/print/whole_print_record.hpp>
#include <telefab/fab/print/whole_print_runner.hpp>

#include "beating_clock.hpp"
#include "plan_print.hpp"
#include "print_records.hpp"

namespace telefab::fab {
namespace {

namespace fs = std::filesystem;

/// Of the last part of a file the printer may check all of it before it answers (SdcpOptions::part_timeout).
constexpr auto kLongestAnswer = std::chrono::seconds{240};

PrinterChoice choice_of(const MachineProfile& machine) {
  return {machine.devices.printer_address, machine.devices.printer_id};
}

/// What the line does is the machine's to have: it was not found.
Error lost(const Error& why) {
  const bool is_of_the_line = why.code == ErrorCode::Unreachable || why.code == ErrorCode::DeviceTimeout;
  return {is_of_the_line ? ErrorCode::DeviceLost : why.code, why.what};
}

/// Whether a print that the printer was asked for is looked for again behind that: it goes on there all the same.
bool is_watched_on(ErrorCode code) {
  return code == ErrorCode::DeviceLost || code == ErrorCode::ProtocolBroken || code == ErrorCode::DeviceRefused;
}

/// Whether a print has no file for its printer because of the profile as it is now.
bool is_misfit(ErrorCode code) { return code == ErrorCode::InvalidInput || code == ErrorCode::Conflict; }

/// The print that a printer was asked for, to watch it: what the printer knows it by.
WholePrintJob watched_job(const PrinterJournalEntry& planned) {
  WholePrintJob job;
  job.plan = planned.plan;
  job.file.name = planned.file;
  job.file.md5 = planned.md5;
  return job;
}

/// One print of one plan folder.
class WholePrint {
 public:
  WholePrint(const PrintTask& task, PrinterChoice printer, std::unique_ptr<PlannedJob> planned, PrintJournal orders,
             PrinterJournal journal)
      : task_{task},
        printer_{std::move(printer)},
        planned_{std::move(planned)},
        orders_{std::move(orders)},
        journal_{std::move(journal)},
        made_{is_to_begin_again() ? LayerIndex{0} : std::min(task.seen, layers())} {}

  static Result<std::unique_ptr<WholePrint>> open(const PrintTask& task, PrinterChoice printer) {
    auto planned = PlannedJob::open(task.folder / "plan");
    if (!planned) return tl::unexpected{planned.error()};
    auto order_file = open_journal_file(task.folder / "journal");
    if (!order_file) return tl::unexpected{order_file.error()};
    auto orders = PrintJournal::open(std::move(*order_file));
    if (!orders) return tl::unexpected{orders.error()};
    auto file = open_journal_file(printer_journal_path(task.folder));
    if (!file) return tl::unexpected{file.error()};
    auto journal = PrinterJournal::open(std::move(*file));
    if (!journal) return tl::unexpected{journal.error()};
    return std::make_unique<WholePrint>(task, std::move(printer), std::move(*planned), std::move(*orders),
                                        std::move(*journal));
  }

  /// Nothing may begin that these forbid.
  Result<void> check() const {
    if (const ResumePoint lit = orders_.resume_point(); lit.next.count() > 0 || lit.maybe_exposed)
      return fail(ErrorCode::Conflict,
                  fmt::format("its print began by light of this fab, and {} makes its own; name the machine with its "
                              "part in the list again, or cancel the job",
                              task_.instance));
    if (task_.seen.count() > 0 && journal_.stage() <= PrinterStage::Uploaded && !is_decided())
      return fail(
          ErrorCode::Conflict,
          "the job list saw layers printed of which the journal knows nothing; restart the fab, and decide what "
          "it asks");
    return check_let_through(task_.folder, orders_);
  }

  Result<PrintReport> run(PrintControl& control, const StandingSink& sink, std::atomic<std::uint64_t>& beats,
                          const std::stop_token& stop) {
    SystemClock clock;
    BeatingClock beating{clock, beats};
    WholePrintReport last;
    if (journal_.stage() != PrinterStage::Finished) {
      sink({.layers = layers(), .message = "writes the file for the printer"});
      const auto ran = run_at_printer(control, sink, beating, beats, stop);
      if (!ran) return tl::unexpected{ran.error()};
      last = *ran;
    }
    if (journal_.stage() != PrinterStage::Finished) {
      auto report = report_of(last);
      if (report.verdict == PrintVerdict::Cancelled)
        if (auto kept = keep_record(); !kept) return tl::unexpected{kept.error()};
      return report;
    }
    if (auto kept = keep_record(); !kept) return tl::unexpected{kept.error()};
    std::error_code ignored;  // large, and made again from the plan where it is wanted
    fs::remove(file(), ignored);
    return report_of_end(*journal_.last(PrinterStep::Finished), last);
  }

 private:
  [[nodiscard]] fs::path file() const { return printer_file_path(task_.folder); }
  [[nodiscard]] LayerIndex layers() const {
    return LayerIndex{static_cast<std::uint32_t>(planned_->plan().layers.size())};
  }
  [[nodiscard]] bool is_decided() const {
    return journal_.last(PrinterStep::Starting) != nullptr || journal_.last(PrinterStep::DecidedStartAgain) != nullptr;
  }
  /// An operator had it started again, and it has not been since: no layer of that print is made.
  [[nodiscard]] bool is_to_begin_again() const {
    const PrinterJournalEntry* decided = journal_.last(PrinterStep::DecidedStartAgain);
    const PrinterJournalEntry* started = journal_.last(PrinterStep::Started);
    return decided != nullptr && (started == nullptr || decided > started);  // both in one vector
  }
  [[nodiscard]] bool is_asked() const { return journal_.stage() >= PrinterStage::StartUnknown; }

  [[nodiscard]] bool is_held() const {
    return !is_asked() && (orders_.order().order == Order::Pause || orders_.order().order == Order::Cancel);
  }
  static WholePrintReport held() {
    return {WholePrintOutcome::Held, PrinterProblem::None, "paused before its start; resume it to go on", {}};
  }

  /// A word that is to hold the print ends the work on its file.
  Result<WholePrintFile> file_made(FileThere there, PrintControl& control, Clock& clock,
                                   std::atomic<std::uint64_t>& beats, const std::stop_token& stop) {
    if (!task_.profile) return tl::unexpected{task_.profile.error()};
    std::stop_source held;
    const std::stop_callback with_site{stop, [&] { held.request_stop(); }};
    Result<void> kept;
    auto made = whole_print_file(
        planned_->plan(), *planned_, *task_.profile, file(), there,
        [&](const Progress&) {
          ++beats;
          if (is_asked() || !kept) return;  // the runner passes words on
          kept = keep_words(control, orders_, clock.wall());
          if (!kept || is_held()) held.request_stop();
        },
        held.get_token());
    if (!kept) return tl::unexpected{kept.error()};
    return made;
  }

  Result<WholePrintReport> run_at_printer(PrintControl& control, const StandingSink& sink, Clock& clock,
                                          std::atomic<std::uint64_t>& beats, const std::stop_token& stop) {
    const PrinterJournalEntry* written = journal_.last(PrinterStep::Planned);
    const auto md5 = written != nullptr ? md5_of_file(file()) : fail(ErrorCode::NotFound, "");
    const bool is_there = is_asked() || (md5 && *md5 == written->md5);
    auto made = file_made(is_there ? FileThere::IsSent : FileThere::IsMadeAgain, control, clock, beats, stop);
    if (!made && is_held()) return held();
    WholePrintPolicy policy;
    policy.starts = task_.may_start == MayStart::Yes;
    const bool fits =
        made ? written == nullptr || !is_asked() || made->job.file.md5 == written->md5 : !is_misfit(made.error().code);
    if (!fits) {
      // The profile became another or went; it can be put right, and what is at its printer is watched whatever it is.
      if (!is_asked() || written == nullptr) return fail(ErrorCode::Conflict, made.error().what);
      made = WholePrintFile{watched_job(*written), 0};
      policy.starts = false;
    }
    if (!made) return tl::unexpected{made.error()};
    if (!policy.starts && !is_asked()) return fail(ErrorCode::Conflict, "the printer was not asked to start it");
    const auto network = make_printer_network();
    const WholePrintSink events = sink_of(sink, beats);
    while (true) {
      const auto printer = sought_printer(*network, clock, printer_);
      auto ran = WholePrintRunner{*printer, journal_, clock, &orders_, task_.fence.get()}.run(made->job, policy,
                                                                                              control, events, stop);
      if (ran) return ran;
      const Error why = lost(ran.error());
      // What the printer was asked for goes on there; nobody has to say that it is to be watched.
      if (!is_asked() || !is_watched_on(why.code) || stop.stop_requested()) return tl::unexpected{why};
      events({.phase = WholePrintPhase::Lost, .message = why.what});
      clock.sleep_for(policy.poll);
    }
  }

  [[nodiscard]] WholePrintSink sink_of(const StandingSink& sink, std::atomic<std::uint64_t>& beats) {
    return [this, &sink, &beats](const WholePrintEvent& event) {
      ++beats;  // a long upload waits for nothing
      PrintStanding standing;
      standing.layer = made_;
      standing.layers = layers();
      switch (event.phase) {
        case WholePrintPhase::Checking:
          break;
        case WholePrintPhase::Uploading:
          standing.message = fmt::format("sends the file to the printer, {} %", static_cast<int>(event.share * 4) * 25);
          break;
        case WholePrintPhase::Starting:
          standing.message = "asked the printer to start";
          break;
        case WholePrintPhase::Printing: {
          made_ = std::max(made_, LayerIndex{std::min(event.task.layer, layers().count())});
          standing.layer = made_;
          if (event.task.estimated > event.task.elapsed) standing.left = event.task.estimated - event.task.elapsed;
          const bool is_paused = event.task.state == TaskState::Paused || event.task.state == TaskState::Pausing;
          standing.activity = is_paused ? PrintActivity::Paused : PrintActivity::Works;
          if (is_paused) standing.message = "paused at the printer";
          standing.now = {std::string{name_of(event.task.state)}, event.task.state == TaskState::Exposing, {}, {}};
          if (event.task.state == TaskState::Stopping) standing.message = "the printer stops";
          last_ = standing;
          break;
        }
        case WholePrintPhase::Lost:
          standing = last_.value_or(standing);
          standing.is_lost = true;
          standing.now.reset();
          standing.message = fmt::format("no answer from the printer: {}{}", event.message,
                                         is_asked() ? "; it goes on by itself" : "");
          break;
        case WholePrintPhase::Refused:
          standing = last_.value_or(standing);
          standing.message = event.message;
          break;
      }
      sink(standing);
    };
  }

  /// It is not over.
  [[nodiscard]] PrintReport report_of(const WholePrintReport& last) const {
    PrintReport report;
    report.next = made_;
    report.is_nothing_made = !is_asked();
    const bool is_cancelled = orders_.order().order == Order::Cancel;
    switch (last.outcome) {
      case WholePrintOutcome::AwaitingDecision:
        if (is_cancelled) {
          report.verdict = PrintVerdict::Cancelled;
          report.message = "nobody knows whether the printer was started; look at it, and stop it at its panel";
        } else {
          report.question = OpenQuestion::Start;
          report.message = question_about_start(planned_->plan().job);
        }
        break;
      case WholePrintOutcome::Held:
        report.verdict = is_cancelled ? PrintVerdict::Cancelled : PrintVerdict::Waits;
        report.message = is_cancelled ? "before its start" : last.message;
        break;
      case WholePrintOutcome::Withheld:
        report.withheld = last.withheld;
        report.message = last.message;
        break;
      case WholePrintOutcome::Sent:
        report.message =
            "the printer was asked to start it before the fab was started again, and did not; telefab resume asks "
            "again";
        break;
      case WholePrintOutcome::Refused:
        report.trouble = MachineTrouble::Fault;
        report.why = last.message;
        report.message = fmt::format("{}; telefab resume tries again", last.message);
        break;
      case WholePrintOutcome::Done:
      case WholePrintOutcome::Stopped:
      case WholePrintOutcome::Unknown:
      case WholePrintOutcome::Interrupted:
        report.message = fmt::format("{}; telefab resume goes on", last.message);
        break;
    }
    return report;
  }

  [[nodiscard]] PrintReport report_of_end(const PrinterJournalEntry& end, const WholePrintReport& last) const {
    PrintReport report;
    report.next = LayerIndex{std::min(std::max(made_.count(), last.task.layer), layers().count())};
    switch (end.end) {
      case PrinterEnd::Done:
        report.verdict = PrintVerdict::Done;
        report.next = layers();
        report.message = "light: by the printer";
        break;
      case PrinterEnd::Stopped:
        if (orders_.order().order == Order::Cancel) {
          report.verdict = PrintVerdict::Cancelled;
          report.message = fmt::format("at layer {}", report.next.count());
        } else {
          report.verdict = PrintVerdict::Failed;
          report.message =
              fmt::format("stopped at the printer, at layer {}{}{}", report.next.count(),
                          end.problem == PrinterProblem::None ? "" : ": ",
                          end.problem == PrinterProblem::None ? std::string_view{} : advice_on(end.problem));
        }
        break;
      case PrinterEnd::Unknown:
        report.verdict = orders_.order().order == Order::Cancel ? PrintVerdict::Cancelled : PrintVerdict::Failed;
        report.message = "the printer does not say how the print ended; look at it and at the part on its platform";
        break;
    }
    return report;
  }

  Result<void> keep_record() const {
    WholePrintContext context;
    context.job = planned_->plan().job;
    context.machine = planned_->plan().machine;
    context.orders = orders_.orders();
    context.provenance = provenance_of(task_.folder, task_.instance);
    return keep_records(task_.folder, journal_, std::move(context));
  }

  const PrintTask& task_;
  PrinterChoice printer_;
  std::unique_ptr<PlannedJob> planned_;
  PrintJournal orders_;
  PrinterJournal journal_;
  LayerIndex made_;
  std::optional<PrintStanding> last_;
};

}  // namespace

Nanoseconds WholePrinterMachine::longest_silence() const { return kLongestAnswer; }

Result<PrintReport> WholePrinterMachine::print(const PrintTask& task, PrintControl& control, const StandingSink& sink,
                                               std::atomic<std::uint64_t>& beats, std::stop_token stop) {
  const auto print = WholePrint::open(task, choice_of(profile_));
  if (!print) return tl::unexpected{print.error()};
  if (auto may = (*print)->check(); !may) return tl::unexpected{may.error()};
  return (*print)->run(control, sink, beats, stop);
}

std::optional<MachineLook> WholePrinterMachine::look() {
  SystemClock clock;
  const auto network = make_printer_network();
  const auto printer = chosen_printer(*network, clock, choice_of(profile_));
  const auto status = printer ? (*printer)->status() : Result<WholePrinterStatus>{tl::unexpected{printer.error()}};
  MachineLook look;
  if (!status) {
    look.is_found = false;
    look.why = status.error().what;
  } else if (status->activity.prints) {
    look.foreign = status->task.file.empty() ? "something" : status->task.file;
  }
  return look;
}

Result<void> forget_unasked(const fs::path& folder, const std::string& machine) {
  const fs::path path = printer_journal_path(folder);
  std::error_code error;
  if (!fs::exists(path, error)) return {};
  auto file = open_journal_file(path);
  if (!file) return tl::unexpected{file.error()};
  const auto journal = PrinterJournal::open(std::move(*file));
  if (!journal) return tl::unexpected{journal.error()};
  for (const PrinterStep step :
       {PrinterStep::Starting, PrinterStep::DecidedStartAgain, PrinterStep::DecidedTreatAsStarted})
    if (journal->last(step) != nullptr)
      return fail(ErrorCode::Conflict,
                  fmt::format("its print was given to a whole printer, which {} is not; name that one in the list of "
                              "machines again, or cancel the job",
                              machine));
  fs::remove(path, error);
  if (error) return fail_system("remove", path, error.value());
  fs::remove(printer_file_path(folder), error);
  return {};
}

}  // namespace telefab::fab
