// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <optional>
#include <string>
#include <telefab/fab/print/print_journal.hpp>
#include <telefab/fab/print/printer_journal.hpp>

namespace telefab::fab {

/// A word about a print that is not on its machine now; it goes into the print's journal, from which the next start of
/// the print takes it.
struct PrintWord {
  JournalStep step = JournalStep::Approved;  ///< Approved, PauseAsked, Resumed or CancelAsked
  std::string by;
  std::string why;                          ///< Approved only: the reason for letting a held job through; may be empty
  std::optional<Decision> decision;         ///< Resumed only: about the layers in question
  std::optional<StartDecision> start = {};  ///< Resumed only, of a whole print: about the start in question
};

/// Durable when it returns. Damage in the journal is set aside on the word. `layers_in_store`: how far the job store
/// has seen the print. Conflict: a word to go on about a cancelled print, one without a decision while layers are in
/// question, or a decision while none is; fails as PrintJournal::write does.
[[nodiscard]] Result<void> keep_word(PrintJournal& journal, const PrintPlan& plan, LayerIndex layers_in_store,
                                     const PrintWord& word, Nanoseconds wall);

/// "the printer was perhaps asked ...: telefab resume JOB --as start-again|treat-as-started".
[[nodiscard]] std::string question_about_start(const std::string& job);
/// "layer 4 was perhaps exposed: ... telefab resume JOB --as treat-as-exposed|expose-again", for one layer or more.
[[nodiscard]] std::string question_about(const ResumePoint& point, const std::string& job);

}  // namespace telefab::fab
