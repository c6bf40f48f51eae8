// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <cstdint>
#include <memory>
#include <string>
#include <telefab/base/clock.hpp>
#include <telefab/base/digest.hpp>
#include <telefab/fab/device/whole_printer.hpp>
#include <telefab/fab/print/print_journal.hpp>
#include <vector>

namespace telefab::fab {

/// What was done of a print on a printer that owns its light.
enum class PrinterStep : std::uint8_t {
  Planned,
  Uploaded,    ///< the printer has the file and has checked it
  Starting,    ///< about to ask for the start: from here on nobody knows, until one of the next two
  NotStarted,  ///< the printer refused, or does nothing of it
  Started,
  Finished,
  DecidedStartAgain,      ///< an operator about a start that nobody knows of
  DecidedTreatAsStarted,  ///< likewise
  PauseAsked,
  Resumed,
  CancelAsked,
  SetAside,  ///< the journal before this one was damaged; a word about its start follows
};
/// An operator's word about a start that nobody knows of.
enum class StartDecision : std::uint8_t { StartAgain, TreatAsStarted };
/// How a print ended.
enum class PrinterEnd : std::uint8_t {
  Done,
  Stopped,
  Unknown,  ///< the printer has done something else since: whether ours came to its end, it no longer says
};
[[nodiscard]] std::string_view name_of(PrinterEnd end);
/// "planned", "uploaded", ...
[[nodiscard]] std::string_view name_of(PrinterStep step);

struct PrinterJournalEntry {
  PrinterStep step = PrinterStep::Planned;
  Nanoseconds wall{};
  Digest plan;                                    ///< Planned
  std::string printer;                            ///< Starting: id of its board
  std::string printer_name;                       ///< Starting: model and firmware, for people
  std::string file;                               ///< Planned: its name on the printer
  std::string md5;                                ///< Planned: of the file
  std::string task;                               ///< Starting: the task that it had before; Started: its own
  PrinterProblem problem = PrinterProblem::None;  ///< NotStarted, Finished
  PrinterEnd end = PrinterEnd::Done;              ///< Finished
  std::uint32_t attempt = 0;                      ///< Starting: of the fleet's job; 0: it is no job of a fleet
  std::string by;                                 ///< Decided*, *Asked, Resumed, SetAside: whose word
};
/// The word as a line of the journal.
[[nodiscard]] PrinterJournalEntry entry_of(StartDecision decision, std::string by, Nanoseconds wall);

/// Where such a print is.
enum class PrinterStage : std::uint8_t { Nothing, Planned, Uploaded, StartUnknown, Printing, Finished };

/// A record line (record_line.hpp) of JSON a step; each is on disk before what it announces is done. Threads: one
/// caller at a time.
class PrinterJournal {
 public:
  /// Cuts a torn tail off. Fails: NotTrusted (damaged, or of a version that is not known: nobody can say what was
  /// done), Storage* as the file does.
  [[nodiscard]] static Result<PrinterJournal> open(std::unique_ptr<JournalFile> file);
  /// The damaged journal in `file` is kept beside, and another one begins with an operator's word about its start.
  /// Fails as the file does.
  [[nodiscard]] static Result<void> begin_again(JournalFile& file, StartDecision decision, const std::string& by,
                                                Nanoseconds wall);
  [[nodiscard]] const std::vector<PrinterJournalEntry>& entries() const { return entries_; }
  [[nodiscard]] PrinterStage stage() const;
  /// The last entry of that kind; nullptr: none.
  [[nodiscard]] const PrinterJournalEntry* last(PrinterStep step) const;
  /// The last word of an operator.
  [[nodiscard]] Order order() const;
  /// Appends and syncs. StorageFailed: what it announces must not be done.
  [[nodiscard]] Result<void> write(PrinterJournalEntry entry);

 private:
  explicit PrinterJournal(std::unique_ptr<JournalFile> file) : file_{std::move(file)} {}
  std::unique_ptr<JournalFile> file_;
  std::vector<PrinterJournalEntry> entries_;
  bool broken_ = false;
};

}  // namespace telefab::fab
