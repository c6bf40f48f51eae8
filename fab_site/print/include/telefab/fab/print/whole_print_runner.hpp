// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <functional>
#include <stop_token>
#include <telefab/fab/print/print_runner.hpp>
#include <telefab/fab/print/printer_journal.hpp>

namespace telefab::fab {

/// A plan as a printer takes it.
struct WholePrintJob {
  Digest plan;
  PrinterUpload file;
  std::string file_kind;  ///< "GOO"
  std::string model;      ///< that the file names
  PixelSize size;
  std::uint32_t layers = 0;
};

/// What a whole print is about.
enum class WholePrintPhase : std::uint8_t {
  Checking,  ///< whether the printer is the right one and idle
  Uploading,
  Starting,  ///< asked to start, not seen to print yet
  Printing,
  Lost,     ///< no connection; the printer goes on by itself
  Refused,  ///< the printer said no to an operator's word
};
[[nodiscard]] std::string_view name_of(WholePrintPhase phase);

struct WholePrintEvent {
  WholePrintPhase phase = WholePrintPhase::Checking;
  double share = 0;     ///< Uploading: of the file
  PrinterTask task;     ///< Printing: as the printer says
  std::string message;  ///< for people: Lost, Refused
};
using WholePrintSink = std::function<void(const WholePrintEvent&)>;

/// How a run ended.
enum class WholePrintOutcome : std::uint8_t {
  Done,
  Stopped,           ///< by somebody, or by the printer (problem)
  Unknown,           ///< as PrinterEnd::Unknown
  Refused,           ///< nothing was started (problem); may be run again
  AwaitingDecision,  ///< perhaps started: decide_start(), then run again
  Held,              ///< nothing was started: an operator's pause or cancel stands
  Sent,              ///< the printer has the file; nothing was started (WholePrintPolicy::starts)
  Interrupted,       ///< asked to stop; a print under way goes on at the printer
  Withheld,          ///< nothing was started: the fence gave no leave (withheld)
};
[[nodiscard]] std::string_view name_of(WholePrintOutcome outcome);

struct WholePrintReport {
  WholePrintOutcome outcome = WholePrintOutcome::Done;
  PrinterProblem problem = PrinterProblem::None;
  std::string message;  ///< for people: what and what to do
  PrinterTask task;     ///< last known
  FenceRefusal withheld = FenceRefusal::None;
};

struct WholePrintPolicy {
  Nanoseconds poll = std::chrono::seconds{2};            ///< between two questions; > 0
  Nanoseconds start_wait = std::chrono::seconds{30};     ///< for a start to show; >= poll
  Nanoseconds patience = std::chrono::minutes{10};       ///< without an answer, then the run fails and may be run again
  Nanoseconds contact = std::chrono::seconds{20};        ///< the same before anything was started
  Nanoseconds longest_leave = std::chrono::seconds{10};  ///< for the leave of a fence; >= 0
  bool starts = true;                                    ///< else the file is sent and checked, and that is all
  std::uint32_t uploads = 3;                             ///< tries to send the file; >= 1
};

/// Hands a plan to a printer that owns its light, and watches it. Light: by the printer; this side never makes any, and
/// cannot end it but by the printer's own pause and stop. A print is asked for at most once: the question is in the
/// journal before it is asked, and where its answer is lost the printer's own task decides - or an operator.
class WholePrintRunner {
 public:
  /// All must outlive the runner. `orders`: the journal that keeps operators' words, without a living one of which
  /// nothing is started; null: `journal` keeps them, and whoever runs it is the operator. `fence`: without whose leave
  /// nothing is started; what a printer was asked for needs none. Null: the print is nobody else's to give away.
  WholePrintRunner(WholePrinter& printer, PrinterJournal& journal, Clock& clock, PrintJournal* orders = nullptr,
                   LightFence* fence = nullptr)
      : printer_{printer}, journal_{journal}, clock_{clock}, orders_{orders}, fence_{fence} {}

  /// Checks the printer against the job, sends the file, starts it and watches it to its end, or goes on where the
  /// journal ends. A second cancel while the printer does not answer gives the print up (Unknown). Fails where nothing
  /// more can be done now and running again later may: Unreachable, Device*, StorageFailed; NotTrusted: the journal is
  /// of another plan.
  [[nodiscard]] Result<WholePrintReport> run(const WholePrintJob& job, const WholePrintPolicy& policy,
                                             PrintControl& control, const WholePrintSink& sink, std::stop_token stop);

 private:
  WholePrinter& printer_;
  PrinterJournal& journal_;
  Clock& clock_;
  PrintJournal* orders_;
  LightFence* fence_;
};

/// Keeps the words that wait; all that is to be done about them while nothing was asked of a printer. Fails as
/// PrintJournal::write does.
[[nodiscard]] Result<void> keep_words(PrintControl& control, PrintJournal& orders, Nanoseconds wall);

/// An operator's word about a start that nobody knows of; in the journal when this returns. Conflict: none is open.
[[nodiscard]] Result<void> decide_start(PrinterJournal& journal, StartDecision decision, std::string by,
                                        Nanoseconds wall);

/// What keeps a file from a printer; None: nothing. In `message` what differs, for people.
struct PrinterMisfit {
  PrinterProblem problem = PrinterProblem::None;
  std::string message;
};
[[nodiscard]] PrinterMisfit misfit_of(const WholePrintJob& job, const WholePrinterFacts& printer);

}  // namespace telefab::fab
