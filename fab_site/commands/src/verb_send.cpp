// SPDX-License-Identifier: GPL-3.0-or-later
#include <fcntl.h>
#include <fmt/format.h>
#include <unistd.h>

#include <cerrno>
#include <filesystem>
#include <memory>
#include <nlohmann/json.hpp>
#include <telefab/base/file.hpp>
#include <telefab/base/json_text.hpp>
#include <telefab/base/open_file.hpp>
#include <telefab/command_line/machine_choice.hpp>
#include <telefab/command_line/output.hpp>
#include <telefab/fab/drivers/choose_printer.hpp>
#include <telefab/fab/formats/whole_print_file.hpp>
#include <telefab/fab/planning/plan_folder.hpp>
#include <telefab/fab/planning/preflight.hpp>
#include <telefab/fab/print/whole_print_record.hpp>
#include <telefab/fab/print/whole_print_runner.hpp>

#include "read_stack.hpp"
#include "verbs.hpp"

namespace telefab::fab {
namespace {

namespace fs = std::filesystem;
using Json = nlohmann::ordered_json;

struct Options {
  std::string plan;
  std::string to;
  std::string work;
  std::string decision;
  MachineChoice machine;
  std::vector<std::string> although;
  std::uint16_t question_port = kSdcpQuestionPort;
  bool starts = false;
  bool begins_again = false;
  bool is_json = false;
};

/// The file is made again until the printer has been asked to start: the same plan gives the same bytes.
Result<WholePrintJob> job_of(PlannedJob& planned, const MachineProfile& machine, const Options& o, const fs::path& work,
                             bool is_asked, const std::stop_token& stop) {
  auto made = whole_print_file(planned.plan(), planned, machine, work / "print.goo",
                               is_asked ? FileThere::IsSent : FileThere::IsMadeAgain, progress_line(), stop);
  clear_progress();
  if (!made) return tl::unexpected{made.error()};
  if (made->other_motions > 0 && !o.is_json)
    write_note(fmt::format("telefab-fab: {} layers tilt, which a GOO file cannot say; the printer moves as it is set\n",
                           made->other_motions));
  return std::move(made->job);
}

Json json_of(const PrinterTask& task) {
  return {{"id", task.id},
          {"file", task.file},
          {"state", name_of(task.state)},
          {"layer", task.layer},
          {"layers", task.layers},
          {"elapsed_ms", task.elapsed.count()},
          {"estimated_ms", task.estimated.count()}};
}

/// A line an event: of a print under way one a layer.
WholePrintSink sink_of(const Options& o) {
  struct Last {
    WholePrintPhase phase = WholePrintPhase::Checking;
    std::uint32_t layer = 0;
    int percent = -1;
    TaskState state = TaskState::None;
  };
  const auto last = std::make_shared<Last>();
  return [last, is_json = o.is_json](const WholePrintEvent& e) {
    const int percent = static_cast<int>(e.share * 100) / 10 * 10;
    const bool is_new = e.phase != last->phase || e.task.layer != last->layer || percent != last->percent ||
                        e.task.state != last->state;
    *last = {e.phase, e.task.layer, percent, e.task.state};
    if (!is_new) return;
    if (is_json) {
      Json json{{"phase", name_of(e.phase)}};
      if (e.phase == WholePrintPhase::Uploading) json["share"] = e.share;
      if (e.phase == WholePrintPhase::Printing) json["task"] = json_of(e.task);
      if (!e.message.empty()) json["message"] = e.message;
      write_output(json_text(json) + "\n");
    } else if (e.phase == WholePrintPhase::Uploading) {
      write_note(fmt::format("telefab-fab: {} % sent\n", percent));
    } else if (e.phase == WholePrintPhase::Printing) {
      write_note(fmt::format("telefab-fab: {}, layer {} of {}\n", name_of(e.task.state), e.task.layer, e.task.layers));
    } else {
      write_note(fmt::format("telefab-fab: {}{}{}\n", name_of(e.phase), e.message.empty() ? "" : ": ", e.message));
    }
    (void)flush_output();  // whoever watches; run_program reports a failure
  };
}

ExitCode code_of(WholePrintOutcome outcome) {
  switch (outcome) {
    case WholePrintOutcome::Done:
    case WholePrintOutcome::Sent:
      return ExitCode::Ok;
    case WholePrintOutcome::Stopped:
    case WholePrintOutcome::Unknown:
      return ExitCode::JobFailed;
    case WholePrintOutcome::Refused:
    case WholePrintOutcome::AwaitingDecision:
      return ExitCode::Device;
    case WholePrintOutcome::Held:
    case WholePrintOutcome::Interrupted:
    case WholePrintOutcome::Withheld:
      break;
  }
  return ExitCode::Cancelled;
}

void print_report(const WholePrintReport& report, const Options& o) {
  if (o.is_json) {
    write_output(json_text({{"outcome", name_of(report.outcome)},
                            {"problem", name_of(report.problem)},
                            {"message", report.message},
                            {"task", json_of(report.task)}}) +
                 "\n");
    return;
  }
  switch (report.outcome) {
    case WholePrintOutcome::Done:
      write_output(fmt::format("printed, {} layers; light: by the printer\n", report.task.layers));
      break;
    case WholePrintOutcome::Sent:
      write_output("sent and checked by the printer; nothing was started. Start it with --start\n");
      break;
    case WholePrintOutcome::Interrupted:
      write_note(
          "telefab-fab: no longer watched; a print under way goes on at the printer. The same command watches it "
          "again, telefab-fab printers --address HOST --order stop ends it\n");
      break;
    case WholePrintOutcome::Stopped:
    case WholePrintOutcome::Unknown:
    case WholePrintOutcome::Refused:
    case WholePrintOutcome::AwaitingDecision:
    case WholePrintOutcome::Held:
    case WholePrintOutcome::Withheld:
      write_note(fmt::format("telefab-fab: {}: {}{}\n", name_of(report.outcome), report.message,
                             report.outcome == WholePrintOutcome::AwaitingDecision ? " (--as)" : ""));
  }
}

/// What keeps the plan from a printer.
Result<bool> may_leave(const Options& o) {
  const auto preflight = preflight_in(o.plan);
  if (!preflight) return tl::unexpected{preflight.error()};
  const auto why = let_through(*preflight, fmt::format("{}", fmt::join(o.although, ",")));
  if (!why && why.error().code == ErrorCode::NotPermitted) {
    write_note(fmt::format("telefab-fab: {}: {}\n", o.plan, why.error().what));
    return false;
  }
  if (!why) return tl::unexpected{why.error()};
  if (!why->empty()) write_note(fmt::format("telefab-fab: held, and sent {}\n", *why));
  return true;
}

/// The journal of the print there; where it is over and is to begin again, a new one beside the old.
Result<PrinterJournal> journal_in(const fs::path& work, bool begins_again) {
  const fs::path path = work / "printer.journal";
  const auto open = [&]() -> Result<PrinterJournal> {
    auto file = open_journal_file(path);
    if (!file) return tl::unexpected{file.error()};
    auto journal = PrinterJournal::open(std::move(*file));
    if (!journal) return fail_in(path.string(), journal.error());
    return journal;
  };
  auto journal = open();
  if (!journal || !begins_again) return journal;
  if (journal->stage() != PrinterStage::Finished)
    return fail(ErrorCode::Conflict,
                "--again begins a print that is over; this one is not. Leave the word out to go on");
  int number = 1;
  std::error_code error;
  while (fs::exists(work / fmt::format("printer.journal.{}", number), error)) ++number;
  fs::rename(path, work / fmt::format("printer.journal.{}", number), error);
  if (error) return fail(ErrorCode::StorageFailed, fmt::format("cannot rename {}: {}", path.string(), error.message()));
  return open();
}

Result<ExitCode> send(const Options& o, const std::stop_token& stop) {
  const auto may = may_leave(o);
  if (!may) return tl::unexpected{may.error()};
  if (!*may) return ExitCode::NotCertified;
  auto planned = PlannedJob::open(o.plan);
  if (!planned) return tl::unexpected{planned.error()};
  const auto machine = chosen_machine(o.machine, (*planned)->plan().machine);
  if (!machine) return tl::unexpected{machine.error()};

  // Beside the plan's folder, which is replaced as a whole where the job is planned again.
  std::string plan_path = o.plan;
  while (plan_path.size() > 1 && plan_path.back() == '/') plan_path.pop_back();
  const fs::path work{o.work.empty() ? plan_path + ".sent" : o.work};
  std::error_code error;
  fs::create_directories(work, error);
  if (error)
    return fail(ErrorCode::NotPermitted, fmt::format("cannot make the folder {}: {}", work.string(), error.message()));
  const OpenFile one_at_a_time{::open(work.c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC)};
  if (const int held = take_lock(one_at_a_time); held != 0 && held != EWOULDBLOCK)
    return fail_system("lock", work, held);
  else if (held == EWOULDBLOCK)
    return fail(
        ErrorCode::Conflict,
        fmt::format("another telefab-fab send is at this print ({}); let it go on, or end it first", work.string()));
  auto journal = journal_in(work, o.begins_again);
  if (!journal) return tl::unexpected{journal.error()};
  const bool is_asked = journal->stage() > PrinterStage::Uploaded;
  const auto job = job_of(**planned, *machine, o, work, is_asked, stop);
  if (!job) return tl::unexpected{job.error()};

  SystemClock clock;
  if (!o.decision.empty()) {
    const auto decision = o.decision == "start-again" ? StartDecision::StartAgain : StartDecision::TreatAsStarted;
    if (auto ok = decide_start(*journal, decision, "command line", clock.wall()); !ok)
      return tl::unexpected{ok.error()};
  }
  const auto network = make_printer_network();
  const auto& devices = machine->devices;
  const auto printer = chosen_printer(
      *network, clock, {o.to.empty() ? devices.printer_address : o.to, devices.printer_id, o.question_port});
  if (!printer) return tl::unexpected{printer.error()};
  PrintControl control;
  WholePrintPolicy policy;
  policy.starts = o.starts;
  const auto report = WholePrintRunner{**printer, *journal, clock}.run(*job, policy, control, sink_of(o), stop);
  if (!report) return tl::unexpected{report.error()};
  if (journal->stage() == PrinterStage::Finished)
    if (auto ok = write_file_atomically(work / "record.json", whole_print_record(*journal)); !ok)
      return tl::unexpected{ok.error()};
  print_report(*report, o);
  return code_of(report->outcome);
}

}  // namespace

VerbBody declare_send(VerbOptions& options) {
  auto o = std::make_shared<Options>();
  options.add("PLAN", o->plan, "folder of a plan (telefab-fab plan --out)").required();
  options.add("--to", o->to,
              "the printer, HOST or HOST:PORT; default: devices.printer_address of the profile, else the only one that "
              "answers in the network");
  options.flag("--start", o->starts, "start the print once the printer has the file, and watch it: the printer LIGHTS");
  options.flag("--again", o->begins_again,
               "print once more what was printed before: without it nothing is started twice");
  options
      .add("--although", o->although,
           "NAME of what holds the plan (telefab-fab plan lists it); give every one. A held plan is not sent without")
      .separated_by(',');
  options
      .add("--as", o->decision,
           "after a start that nobody knows of: start-again (the printer stands idle), treat-as-started")
      .one_of({"start-again", "treat-as-started"});
  options.add("--work", o->work,
              "folder of the file that is sent, its journal and, in the end, record.json; default: PLAN.sent");
  options.add("--question-port", o->question_port, "UDP port of the question who is there").shows_default();
  options.flag("--json", o->is_json, "one JSON line an event, the outcome last");
  declare_machine_choice(options, o->machine, "profile that names the file its printer takes; default: the plan's",
                         MachineIs::Optional);
  options.footer(
      "The printer owns light and stage: this program sends the file, checks model, resolution, kind and room before, "
      "and\n"
      "watches. A print is asked for once: the same command again goes on watching, and never starts a second one.\n"
      "Interrupted it stops watching; the printer goes on. telefab-fab printers --address HOST --order stop ends it.");
  return [o](std::stop_token stop) -> Result<ExitCode> { return send(*o, stop); };
}

}  // namespace telefab::fab
