// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <filesystem>
#include <telefab/fab/print/print_word.hpp>
#include <telefab/fab/print/start_rule.hpp>
#include <telefab/job/job.hpp>

#include "open_questions.hpp"

// The order to print as it lies in a job's folder. Callers see to it that nobody prints from the folder meanwhile.
namespace telefab::fab {

inline constexpr const char* kAutomatic = "automatic";  ///< whose word a job prints by where no operator is asked

/// Whose light a job is printed by, as far as its machine is known. Whichever light began a print has it to its end,
/// whatever is said here.
enum class LightOf : std::uint8_t { Fab, WholePrinter };

/// Keeps a word in the folder's journal; durable when it returns. Fails as keep_word of print does; of a whole print
/// also with Conflict where a word about its start is needed and not given, or the other way round.
[[nodiscard]] Result<void> keep_word(const std::filesystem::path& folder, const Job& job, LightOf light,
                                     const PrintWord& word, Nanoseconds wall);

/// A job as the start rule sees it.
struct StartCase {
  StartFacts facts;
  bool has_begun = false;
  ResumePoint point;
  LightOf light = LightOf::Fab;
  /// What is open where it waits for a decision.
  [[nodiscard]] OpenQuestion question() const {
    if (light == LightOf::WholePrinter) return OpenQuestion::Start;
    return point.maybe_exposed ? OpenQuestion::Exposure : OpenQuestion::None;
  }
};
/// Whether a layer of it was exposed, or perhaps: its part hangs in the machine where it began.
[[nodiscard]] inline bool is_part_begun(const StartCase& before, const Job& job) {
  if (before.light == LightOf::WholePrinter)
    return before.facts.is_at_printer || before.facts.is_finished || before.facts.is_damaged ||
           job.counters.layers_printed > 0;
  return before.point.next.count() > 0 || before.point.maybe_exposed || job.counters.layers_printed > 0;
}
/// Fails: StorageFailed, NotPermitted. A plan that cannot be read is another plan.
[[nodiscard]] Result<StartCase> start_case(const std::filesystem::path& folder, const Job& job, LightOf light);

/// The journal of what a whole printer was asked for.
[[nodiscard]] inline std::filesystem::path printer_journal_path(const std::filesystem::path& folder) {
  return folder / "printer.journal";
}
/// The file that a whole printer is sent; there while it may be sent again.
[[nodiscard]] inline std::filesystem::path printer_file_path(const std::filesystem::path& folder) {
  return folder / "printer.goo";
}

}  // namespace telefab::fab
