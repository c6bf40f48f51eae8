// SPDX-License-Identifier: GPL-3.0-or-later
#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <telefab/fab/print/whole_print_runner.hpp>
#include <utility>

namespace telefab::fab {
namespace {

constexpr std::array<std::string_view, 6> kPhases{"checking", "uploading", "starting", "printing", "lost", "refused"};
constexpr std::array<std::string_view, 9> kOutcomes{"done", "stopped", "unknown",     "refused", "awaiting-decision",
                                                    "held", "sent",    "interrupted", "withheld"};

struct Word {
  PrinterStep step;
  std::string by;
};
/// Nothing: a printer that owns its light does not know it, and whoever said it is told so.
std::optional<Word> word_of(const PrintControl::Wish& wish) {
  if (const auto* pause = std::get_if<PauseAsked>(&wish.event)) return Word{PrinterStep::PauseAsked, pause->by};
  if (const auto* resume = std::get_if<ResumeAsked>(&wish.event)) return Word{PrinterStep::Resumed, resume->by};
  if (const auto* cancel = std::get_if<CancelAsked>(&wish.event)) return Word{PrinterStep::CancelAsked, cancel->by};
  if (wish.kept) wish.kept(fail(ErrorCode::Conflict, "a printer that owns its light knows pause, resume and cancel"));
  return std::nullopt;
}

Result<void> keep(PrintJournal& orders, Word word, Nanoseconds wall) {
  JournalEntry entry;
  entry.step = word.step == PrinterStep::PauseAsked ? JournalStep::PauseAsked
               : word.step == PrinterStep::Resumed  ? JournalStep::Resumed
                                                    : JournalStep::CancelAsked;
  entry.wall = wall;
  entry.by = std::move(word.by);
  return orders.write(entry);
}

/// One run: the runner's arguments, and what it knows by now.
class Run {
 public:
  Run(WholePrinter& printer, PrinterJournal& journal, Clock& clock, PrintJournal* orders, LightFence* fence,
      const WholePrintJob& job, const WholePrintPolicy& policy, PrintControl& control, const WholePrintSink& sink,
      std::stop_token stop)
      : printer_{printer},
        journal_{journal},
        clock_{clock},
        orders_{orders},
        fence_{fence},
        job_{job},
        policy_{policy},
        control_{control},
        sink_{sink},
        stop_{std::move(stop)} {}

  Result<WholePrintReport> go() {
    if (auto ok = begin(); !ok) return tl::unexpected{ok.error()};
    while (true) {
      if (stop_.stop_requested()) return *report(WholePrintOutcome::Interrupted, PrinterProblem::None, "asked to stop");
      if (auto ok = take_words(); !ok) return tl::unexpected{ok.error()};
      auto done = step();
      if (is_given_up_ && !done && is_of_the_line(done.error().code)) done = give_up();
      if (!done) return tl::unexpected{done.error()};
      if (*done) return **done;
    }
  }

 private:
  using Step = Result<std::optional<WholePrintReport>>;  ///< nothing: go on

  Result<void> begin() {
    const PrinterJournalEntry* planned = journal_.last(PrinterStep::Planned);
    const bool is_same_file = planned != nullptr && planned->file == job_.file.name && planned->md5 == job_.file.md5;
    // Another release may write the same plan otherwise; before the start was asked for that is another file to send.
    const bool may_be_sent_again = planned != nullptr && planned->plan == job_.plan &&
                                   journal_.stage() <= PrinterStage::Uploaded &&
                                   journal_.last(PrinterStep::Starting) == nullptr;
    if (planned == nullptr || (!is_same_file && may_be_sent_again)) {
      PrinterJournalEntry entry;
      entry.plan = job_.plan;
      entry.file = job_.file.name;
      entry.md5 = job_.file.md5;
      return write(std::move(entry));
    }
    if (planned->plan != job_.plan || !is_same_file)
      return fail(ErrorCode::NotTrusted,
                  "the journal is of the print of another plan, or of this one for another profile; finish that print "
                  "first, or keep the new one in another folder");
    return {};
  }

  /// The printer is out of reach, and an operator does not want to wait for it.
  Step give_up() {
    is_given_up_ = false;
    if (journal_.stage() < PrinterStage::StartUnknown) return std::optional<WholePrintReport>{};  // held
    return finished(PrinterEnd::Unknown, PrinterProblem::None);
  }

  Step step() {
    switch (journal_.stage()) {
      case PrinterStage::Nothing:
      case PrinterStage::Planned:
      case PrinterStage::Uploaded:
        return before_start();
      case PrinterStage::StartUnknown:
        return await_start();
      case PrinterStage::Printing:
        return watch();
      case PrinterStage::Finished:
        break;
    }
    const PrinterJournalEntry& end = *journal_.last(PrinterStep::Finished);
    const WholePrintOutcome outcome = end.end == PrinterEnd::Done      ? WholePrintOutcome::Done
                                      : end.end == PrinterEnd::Stopped ? WholePrintOutcome::Stopped
                                                                       : WholePrintOutcome::Unknown;
    return report(outcome, end.problem,
                  end.end == PrinterEnd::Unknown
                      ? "the printer does not say how it ended; look at it and at the part on its platform"
                      : std::string{advice_on(end.problem)});
  }

  Step before_start() {
    if (is_held())
      return report(WholePrintOutcome::Held, PrinterProblem::None,
                    order() == Order::Pause    ? "paused before its start; resume it to go on"
                    : order() == Order::Cancel ? "cancelled before its start"
                                               : "nobody's word to print it is kept");
    if (!policy_.starts && journal_.stage() == PrinterStage::Uploaded)
      return report(WholePrintOutcome::Sent, PrinterProblem::None, "the printer has the file; nothing was started");
    emit({.phase = WholePrintPhase::Checking});
    const std::uint64_t losses = losses_;
    const auto facts = asked([&] { return printer_.facts(); }, policy_.contact);
    if (!facts) return tl::unexpected{facts.error()};
    if (auto misfit = misfit_of(job_, *facts);
        misfit.problem != PrinterProblem::None &&
        // Room is needed for what is still to be sent.
        !(misfit.problem == PrinterProblem::StorageFull && journal_.stage() == PrinterStage::Uploaded))
      return report(WholePrintOutcome::Refused, misfit.problem, std::move(misfit.message));
    const auto status = asked([&] { return printer_.status(); }, policy_.contact);
    if (!status) return tl::unexpected{status.error()};
    if (losses != losses_) return std::optional<WholePrintReport>{};  // facts and status may be of two printers
    task_ = status->task;
    // Asked before, and taken for not started: where our file is the printer's task now, it started late.
    const PrinterJournalEntry* asked_before = journal_.last(PrinterStep::Starting);
    const PrinterJournalEntry* decided = journal_.last(PrinterStep::DecidedStartAgain);
    const bool is_to_start_again =
        decided != nullptr && (asked_before == nullptr || decided > asked_before);  // both in one vector
    if (asked_before != nullptr && !is_to_start_again && status->task.file == job_.file.name &&
        !status->task.id.empty() && status->task.id != asked_before->task) {
      if (auto ok = same_printer(); !ok) return tl::unexpected{ok.error()};
      return started(status->task.id);
    }
    if (status->activity.prints || status->activity.tests)
      return report(WholePrintOutcome::Refused, PrinterProblem::Busy,
                    fmt::format("the printer prints {}; {}", status->task.file, advice_on(PrinterProblem::Busy)));
    if (journal_.stage() != PrinterStage::Uploaded) return upload();
    return start(status->task.id, *facts);
  }

  /// Whoever was asked to start must be the one that is watched: an address may have gone to another printer, also
  /// while nothing answered there.
  Result<void> same_printer() {
    if (is_known_) return {};
    const PrinterJournalEntry* asked_one = journal_.last(PrinterStep::Starting);
    if (asked_one == nullptr || asked_one->printer.empty()) {
      is_known_ = true;  // as far as anybody can
      return {};
    }
    const std::string id = asked_one->printer;
    const auto facts = asked([&] { return printer_.facts(); });
    if (!facts) return tl::unexpected{facts.error()};
    if (facts->id != id)
      return fail(ErrorCode::NotTrusted,
                  fmt::format("the print was given to the printer {}, and {} answers; give the address of the former",
                              id, facts->id));
    is_known_ = true;
    return {};
  }

  Step upload() {
    Error last;
    PrinterProblem problem = PrinterProblem::None;
    for (std::uint32_t i = 0; i < policy_.uploads; ++i) {
      if (i > 0) clock_.sleep_for(policy_.poll);
      const auto sent = upload_once();
      if (sent && *sent == Sent::Whole) {
        PrinterJournalEntry entry;
        entry.step = PrinterStep::Uploaded;
        if (auto ok = write(std::move(entry)); !ok) return tl::unexpected{ok.error()};
        return std::optional<WholePrintReport>{};
      }
      if (sent && *sent == Sent::Stopped) return std::optional<WholePrintReport>{};  // the loop looks at why
      problem = upload_problem_;
      if (problem == PrinterProblem::Other)
        if (const auto status = asked([&] { return printer_.status(); }); status && !status->activity.is_idle())
          problem = PrinterProblem::Busy;
      if (sent && problem != PrinterProblem::FileDamaged)
        return report(WholePrintOutcome::Refused, problem, std::string{advice_on(problem)});
      if (!sent) last = sent.error();
      if (!sent && !is_of_the_line(last.code)) return tl::unexpected{last};
    }
    if (problem != PrinterProblem::None)
      return report(WholePrintOutcome::Refused, problem, std::string{advice_on(problem)});
    const auto failed = fail_in(fmt::format("the file could not be sent in {} tries", policy_.uploads), last);
    // One that answers is not waited for: it would be sent the file for ever.
    if (printer_.status()) return report(WholePrintOutcome::Refused, PrinterProblem::Other, failed.value().what);
    return failed;
  }

  enum class Sent : std::uint8_t { Whole, Stopped, Refused };
  Result<Sent> upload_once() {
    upload_problem_ = PrinterProblem::None;
    if (auto ok = printer_.begin_upload(job_.file); !ok) return tl::unexpected{ok.error()};
    const Nanoseconds begun = clock_.now();
    std::uint64_t before = 0;
    Nanoseconds moved = begun;
    while (true) {
      if (auto ok = take_words(); !ok) return tl::unexpected{ok.error()};
      if (stop_.stop_requested() || is_held()) {
        (void)printer_.end_upload();  // where even that is lost, nothing was started all the same
        return Sent::Stopped;
      }
      const auto step = printer_.send_part();
      if (!step) return tl::unexpected{step.error()};
      if (step->problem != PrinterProblem::None) {
        upload_problem_ = step->problem;
        return Sent::Refused;
      }
      if (step->sent_bytes != before) moved = clock_.now();
      before = step->sent_bytes;
      emit({.phase = WholePrintPhase::Uploading,
            .share = job_.file.bytes == 0 ? 1 : double(step->sent_bytes) / double(job_.file.bytes)});
      if (step->is_done) return Sent::Whole;
      if (clock_.now() - moved > policy_.patience)
        return fail(ErrorCode::DeviceTimeout, "the printer does not come to an end with checking the file");
    }
  }

  [[nodiscard]] Order order() const { return orders_ != nullptr ? orders_->order().order : journal_.order(); }
  /// No start without a living order.
  [[nodiscard]] bool is_held() const {
    const Order now = order();
    return now == Order::Pause || now == Order::Cancel || (orders_ != nullptr && now == Order::None);
  }

  /// Nothing: the printer may be asked to start. Words are heard meanwhile.
  Result<std::optional<Leave>> await_leave() {
    const Nanoseconds due = clock_.now() + policy_.longest_leave;
    while (fence_ != nullptr) {
      Leave leave = fence_->leave(LayerIndex{});
      if (leave.state == LeaveState::Given) break;
      if (leave.state == LeaveState::Refused) return leave;
      if (stop_.stop_requested() || is_held() || clock_.now() >= due)
        return Leave{LeaveState::Refused, FenceRefusal::Unanswered, leave.what};
      clock_.sleep_for(std::chrono::milliseconds{50});
      if (auto ok = take_words(); !ok) return tl::unexpected{ok.error()};
    }
    return std::optional<Leave>{};
  }

  Step start(const std::string& task_before, const WholePrinterFacts& facts) {
    if (auto ok = take_words(); !ok) return tl::unexpected{ok.error()};
    if (is_held() || stop_.stop_requested()) return std::optional<WholePrintReport>{};
    const auto no_leave = await_leave();
    if (!no_leave) return tl::unexpected{no_leave.error()};
    if (is_held() || stop_.stop_requested()) return std::optional<WholePrintReport>{};
    if (*no_leave) {
      auto withheld = report(WholePrintOutcome::Withheld, PrinterProblem::None,
                             fmt::format("the printer is not asked to start it: {}", (*no_leave)->what));
      withheld->withheld = (*no_leave)->why;
      return withheld;
    }
    PrinterJournalEntry entry;
    entry.step = PrinterStep::Starting;
    entry.task = task_before;
    entry.printer = facts.id;
    if (fence_ != nullptr) entry.attempt = fence_->attempt();
    entry.printer_name = fmt::format("{}, firmware {}", facts.model, facts.firmware);
    is_known_ = true;
    const bool was_asked = journal_.last(PrinterStep::Starting) != nullptr;
    if (auto ok = write(std::move(entry)); !ok) return tl::unexpected{ok.error()};
    emit({.phase = WholePrintPhase::Starting});
    const auto answer = printer_.start(job_.file.name);
    if (answer && *answer == PrinterProblem::None) {
      is_promised_ = true;
      return std::optional<WholePrintReport>{};
    }
    if (!answer && (answer.error().code == ErrorCode::DeviceTimeout || answer.error().code == ErrorCode::DeviceLost)) {
      lose();
      emit({.phase = WholePrintPhase::Lost, .message = answer.error().what});
      return std::optional<WholePrintReport>{};
    }
    // Busy behind an earlier question: perhaps with this very file.
    if (answer && *answer == PrinterProblem::Busy && was_asked) return std::optional<WholePrintReport>{};
    PrinterJournalEntry refused;
    refused.step = PrinterStep::NotStarted;
    refused.problem = answer ? *answer : PrinterProblem::Other;
    if (auto ok = write(std::move(refused)); !ok) return tl::unexpected{ok.error()};
    if (!answer) return tl::unexpected{answer.error()};
    const bool wants_file = *answer == PrinterProblem::FileNotFound || *answer == PrinterProblem::FileDamaged;
    if (wants_file && resent_++ < policy_.uploads) return upload();
    return report(WholePrintOutcome::Refused, *answer, std::string{advice_on(*answer)});
  }

  /// What the printer of this print is at; never another's, whatever answers in between.
  Result<WholePrinterStatus> status_of_same() {
    while (true) {
      if (auto ok = same_printer(); !ok) return tl::unexpected{ok.error()};
      auto status = asked([&] { return printer_.status(); });
      if (!status || is_known_) return status;
    }
  }

  /// The printer was asked, by this run or one before. Its task says whether it does it.
  Step await_start() {
    const std::string before = journal_.last(PrinterStep::Starting)->task;
    const Nanoseconds begun = clock_.now();
    bool was_still = true;  // idle behind the same task all the time
    while (true) {
      const auto status = status_of_same();
      if (!status) return tl::unexpected{status.error()};
      task_ = status->task;
      const bool is_ours = status->task.file == job_.file.name;
      const bool is_new = status->task.id != before;
      if (is_ours && (is_new || (is_promised_ && status->task.id.empty() && status->activity.prints)))
        return started(status->task.id);
      was_still = was_still && !is_new && !status->activity.prints;
      if (clock_.now() - begun >= policy_.start_wait) break;
      if (stop_.stop_requested()) return std::optional<WholePrintReport>{};
      if (auto ok = rest(); !ok) return tl::unexpected{ok.error()};
    }
    // The name of the last task is proof only where the printer gives names.
    if (was_still && !before.empty() && !is_promised_) {
      PrinterJournalEntry entry;
      entry.step = PrinterStep::NotStarted;
      if (auto ok = write(std::move(entry)); !ok) return tl::unexpected{ok.error()};
      return std::optional<WholePrintReport>{};
    }
    return report(
        WholePrintOutcome::AwaitingDecision, PrinterProblem::None,
        "the printer was asked to start and does not say whether it did; look at it, then decide: start-again "
        "or treat-as-started");
  }

  Step started(const std::string& task) {
    PrinterJournalEntry entry;
    entry.step = PrinterStep::Started;
    entry.task = task;
    if (auto ok = write(std::move(entry)); !ok) return tl::unexpected{ok.error()};
    return std::optional<WholePrintReport>{};
  }

  Step watch() {
    // Where an operator says that it was started, the task is whichever has the file.
    std::optional<std::string> own;
    for (const PrinterJournalEntry& entry : journal_.entries()) {
      if (entry.step == PrinterStep::Started) own = entry.task;
      if (entry.step == PrinterStep::DecidedTreatAsStarted) own.reset();
    }
    while (true) {
      const auto status = status_of_same();
      if (!status) return tl::unexpected{status.error()};
      const PrinterTask& task = status->task;
      const bool is_ours = own && !own->empty() ? task.id == *own : task.file == job_.file.name;
      if (!is_ours && task.id.empty() && status->activity.prints) {  // says nothing of its task just now
        if (stop_.stop_requested()) return std::optional<WholePrintReport>{};
        if (auto ok = rest(); !ok) return tl::unexpected{ok.error()};
        continue;
      }
      if (!is_ours) return end_from_memory(own);
      task_ = task;
      emit({.phase = WholePrintPhase::Printing, .task = task});
      if (task.state == TaskState::Complete) return finished(PrinterEnd::Done, task.problem);
      if (task.state == TaskState::Stopped || (task.problem != PrinterProblem::None && !status->activity.prints))
        return finished(PrinterEnd::Stopped, task.problem);
      if (stop_.stop_requested()) return std::optional<WholePrintReport>{};
      recall_word(task.state);
      (void)pass_on();  // the sink has what came of it
      if (auto ok = rest(); !ok) return tl::unexpected{ok.error()};
    }
  }

  /// The printer does something else by now; it may remember how ours ended.
  Step end_from_memory(const std::optional<std::string>& own) {
    if (!own || own->empty()) return finished(PrinterEnd::Unknown, PrinterProblem::None);
    const auto known = asked([&] { return printer_.task(*own); });
    if (!known) return tl::unexpected{known.error()};
    if (*known) task_ = **known;
    if (*known && (*known)->state == TaskState::Complete) return finished(PrinterEnd::Done, (*known)->problem);
    if (*known && (*known)->state == TaskState::Stopped) return finished(PrinterEnd::Stopped, (*known)->problem);
    return finished(PrinterEnd::Unknown, PrinterProblem::None);
  }

  Step finished(PrinterEnd end, PrinterProblem problem) {
    PrinterJournalEntry entry;
    entry.step = PrinterStep::Finished;
    entry.end = end;
    entry.problem = problem;
    if (auto ok = write(std::move(entry)); !ok) return tl::unexpected{ok.error()};
    return std::optional<WholePrintReport>{};
  }

  /// Operators' words: journalled, and passed on to a print under way.
  Result<void> take_words() {
    while (auto wish = control_.take()) {
      const auto word = word_of(*wish);
      if (!word) continue;
      is_given_up_ = is_given_up_ || (word->step == PrinterStep::CancelAsked && is_lost_ && order() == Order::Cancel);
      auto kept = keep_word(*word);
      const bool is_written = kept.has_value();
      if (is_written && journal_.stage() == PrinterStage::Printing) {
        unpassed_ = word->step;
        kept = pass_on();
      }
      if (wish->kept) wish->kept(kept);
      if (!is_written) return kept;
    }
    return {};
  }

  /// Between two questions; operators wait for no more than a slice of it.
  Result<void> rest() {
    constexpr Nanoseconds kSlice = std::chrono::milliseconds{200};
    const Nanoseconds until = clock_.now() + policy_.poll;
    while (true) {
      if (auto ok = take_words(); !ok) return ok;
      const Nanoseconds left = until - clock_.now();
      if (left <= Nanoseconds{0} || stop_.stop_requested() || is_given_up_) return {};
      clock_.sleep_for(std::min(left, kSlice));
    }
  }

  Result<void> keep_word(const Word& word) {
    if (orders_ != nullptr) return keep(*orders_, word, clock_.wall());
    PrinterJournalEntry entry;
    entry.step = word.step;
    entry.by = word.by;
    return write(std::move(entry));
  }

  /// The standing word goes to the printer. One that the line lost stays to be passed on with the next question; a word
  /// that the printer refuses is over: DeviceRefused.
  Result<void> pass_on() {
    if (!unpassed_ || !is_known_) return {};
    const PrinterStep word = *unpassed_;
    const auto answer = word == PrinterStep::PauseAsked ? printer_.pause()
                        : word == PrinterStep::Resumed  ? printer_.resume()
                                                        : printer_.stop();
    if (!answer && is_of_the_line(answer.error().code)) {
      lose();
      emit({.phase = WholePrintPhase::Lost, .message = answer.error().what});
      return {};
    }
    unpassed_.reset();
    if (answer && *answer == PrinterProblem::None) return {};
    const std::string why =
        answer ? fmt::format("the printer does not do it: {}", advice_on(*answer)) : answer.error().what;
    emit({.phase = WholePrintPhase::Refused, .message = why});
    return fail(ErrorCode::DeviceRefused, why);
  }

  /// A word from before the start, or from a run before this one, that the printer does not follow yet.
  void recall_word(TaskState state) {
    if (std::exchange(is_recalled_, true) || unpassed_) return;
    const Order order = this->order();
    if (order == Order::Cancel && state != TaskState::Stopping && state != TaskState::Stopped)
      unpassed_ = PrinterStep::CancelAsked;
    if (order == Order::Pause && state != TaskState::Pausing && state != TaskState::Paused)
      unpassed_ = PrinterStep::PauseAsked;
  }

  static bool is_of_the_line(ErrorCode code) {
    return code == ErrorCode::Unreachable || code == ErrorCode::DeviceLost || code == ErrorCode::DeviceTimeout ||
           code == ErrorCode::DeviceRefused || code == ErrorCode::ProtocolBroken;
  }

  /// No answer: whoever answers next may be another printer.
  void lose() {
    ++losses_;
    is_known_ = false;
  }

  /// Asks until there is an answer, the patience is over or somebody wants to stop.
  template <class Ask>
  auto asked(const Ask& ask) -> decltype(ask()) {
    return asked(ask, policy_.patience);
  }
  template <class Ask>
  auto asked(const Ask& ask, Nanoseconds patience) -> decltype(ask()) {
    const Nanoseconds begun = clock_.now();
    while (true) {
      auto answer = ask();
      is_lost_ = !answer && is_of_the_line(answer.error().code);
      if (!is_lost_) return answer;
      lose();
      emit({.phase = WholePrintPhase::Lost, .message = answer.error().what});
      if (auto ok = take_words(); !ok) return tl::unexpected{ok.error()};
      if (is_given_up_) return answer;
      if (stop_.stop_requested() || clock_.now() - begun >= patience) return answer;
      if (auto ok = rest(); !ok) return tl::unexpected{ok.error()};
    }
  }

  Result<void> write(PrinterJournalEntry entry) {
    entry.wall = clock_.wall();
    return journal_.write(std::move(entry));
  }
  void emit(const WholePrintEvent& event) {
    if (sink_) sink_(event);
  }
  std::optional<WholePrintReport> report(WholePrintOutcome outcome, PrinterProblem problem, std::string message) const {
    return WholePrintReport{outcome, problem, std::move(message), task_};
  }

  WholePrinter& printer_;
  PrinterJournal& journal_;
  Clock& clock_;
  PrintJournal* orders_;
  LightFence* fence_;
  const WholePrintJob& job_;
  const WholePrintPolicy& policy_;
  PrintControl& control_;
  const WholePrintSink& sink_;
  std::stop_token stop_;
  PrinterTask task_;
  PrinterProblem upload_problem_ = PrinterProblem::None;
  std::uint32_t resent_ = 0;
  bool is_promised_ = false;  ///< the printer said yes in this run
  std::optional<PrinterStep> unpassed_;
  bool is_recalled_ = false;
  bool is_lost_ = false;      ///< the last question had no answer
  std::uint64_t losses_ = 0;  ///< questions without an answer
  bool is_given_up_ = false;  ///< a second cancel came meanwhile
  bool is_known_ = false;     ///< the printer that answers is the one that was asked to start
};

}  // namespace

std::string_view name_of(WholePrintPhase phase) { return kPhases.at(static_cast<std::size_t>(phase)); }
std::string_view name_of(WholePrintOutcome outcome) { return kOutcomes.at(static_cast<std::size_t>(outcome)); }

PrinterMisfit misfit_of(const WholePrintJob& job, const WholePrinterFacts& printer) {
  if (!printer.takes_files || !printer.takes_orders)
    return {PrinterProblem::WrongFormat, fmt::format("{} takes no files and orders over the network", printer.model)};
  if (std::find(printer.file_kinds.begin(), printer.file_kinds.end(), job.file_kind) == printer.file_kinds.end())
    return {PrinterProblem::WrongFormat, fmt::format("{} takes {} files, not {}", printer.model,
                                                     fmt::join(printer.file_kinds, ", "), job.file_kind)};
  if (printer.size != PixelSize{} && printer.size != job.size)
    return {PrinterProblem::WrongResolution,
            fmt::format("the panel of {} has {} x {} pixels, the plan {} x {}; plan for the profile of this printer",
                        printer.model, printer.size.width_px, printer.size.height_px, job.size.width_px,
                        job.size.height_px)};
  if (printer.model != job.model)
    return {PrinterProblem::WrongModel,
            fmt::format("the printer is \"{}\", the file names \"{}\"; state file.model in the profile as the printer "
                        "calls itself",
                        printer.model, job.model)};
  if (printer.free_bytes && *printer.free_bytes < job.file.bytes)
    return {PrinterProblem::StorageFull,
            fmt::format("the printer has room for {} bytes, the file has {}; delete files at its panel",
                        *printer.free_bytes, job.file.bytes)};
  return {};
}

Result<WholePrintReport> WholePrintRunner::run(const WholePrintJob& job, const WholePrintPolicy& policy,
                                               PrintControl& control, const WholePrintSink& sink,
                                               std::stop_token stop) {
  return Run{printer_, journal_, clock_, orders_, fence_, job, policy, control, sink, std::move(stop)}.go();
}

Result<void> keep_words(PrintControl& control, PrintJournal& orders, Nanoseconds wall) {
  while (const auto wish = control.take()) {
    const auto word = word_of(*wish);
    if (!word) continue;
    const auto kept = keep(orders, *word, wall);
    if (wish->kept) wish->kept(kept);
    if (!kept) return kept;
  }
  return {};
}

Result<void> decide_start(PrinterJournal& journal, StartDecision decision, std::string by, Nanoseconds wall) {
  if (journal.stage() != PrinterStage::StartUnknown)
    return fail(ErrorCode::Conflict, "no start of this print is in question");
  return journal.write(entry_of(decision, std::move(by), wall));
}

}  // namespace telefab::fab
