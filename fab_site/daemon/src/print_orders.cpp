// SPDX-License-Identifier: GPL-3.0-or-later
#include "print_orders.hpp"

#include <fmt/format.h>

#include <telefab/fab/planning/plan_folder.hpp>

namespace telefab::fab {
namespace {

Result<PrintJournal> open_journal(const std::filesystem::path& folder) {
  auto file = open_journal_file(folder / "journal");
  if (!file) return tl::unexpected{file.error()};
  return PrintJournal::open(std::move(*file));
}

bool has_printer_journal(const std::filesystem::path& folder) {
  std::error_code error;
  const auto bytes = std::filesystem::file_size(printer_journal_path(folder), error);
  return !error && bytes > 0;
}

Result<std::unique_ptr<JournalFile>> printer_journal_file(const std::filesystem::path& folder) {
  if (!has_printer_journal(folder)) return memory_journal_file();  // a look leaves none behind
  return open_journal_file(printer_journal_path(folder));
}

/// For a look; an absent one is empty. Nothing: it is damaged.
Result<std::optional<PrinterJournal>> look_into_printer_journal(const std::filesystem::path& folder) {
  auto file = printer_journal_file(folder);
  if (!file) return tl::unexpected{file.error()};
  auto journal = PrinterJournal::open(std::move(*file));
  if (journal) return std::optional{std::move(*journal)};
  if (journal.error().code == ErrorCode::NotTrusted) return std::optional<PrinterJournal>{};
  return tl::unexpected{journal.error()};
}

bool is_begun(const Job& job) { return !is_before(job.state, JobState::Printing) || job.counters.layers_printed > 0; }

/// A machine may have become of the other kind: whoever began a print has it to its end.
bool is_whole(const std::filesystem::path& folder, LightOf light, const PrintJournal& orders) {
  if (has_printer_journal(folder)) return true;
  const ResumePoint lit = orders.resume_point();
  return light == LightOf::WholePrinter && lit.next.count() == 0 && !lit.maybe_exposed;
}

StartFacts facts_of_whole(const std::optional<PrinterJournal>& journal, const PrintJournal& orders,
                          const std::filesystem::path& folder, const Job& job) {
  const auto planned = PlannedJob::open(folder / "plan");
  StartFacts facts =
      facts_of(journal ? &*journal : nullptr, orders, planned ? plan_digest((*planned)->plan()) : Digest{},
               LayerIndex{job.counters.layers_printed}, is_begun(job), job.state == JobState::Paused);
  if (!planned) facts.is_of_this_plan = journal && journal->entries().empty();
  return facts;
}

/// What came of a start, in the printer's journal; in another one where that is damaged.
Result<void> keep_decision(std::unique_ptr<JournalFile> file, bool is_readable, const PrintWord& word,
                           Nanoseconds wall) {
  if (!is_readable) return PrinterJournal::begin_again(*file, *word.start, word.by, wall);
  auto journal = PrinterJournal::open(std::move(file));
  if (!journal) return tl::unexpected{journal.error()};
  return journal->write(entry_of(*word.start, word.by, wall));
}

/// A word about a print on a whole printer: about its start in the printer's journal, then in that of the orders.
Result<void> keep_word_of_whole(const std::filesystem::path& folder, const Job& job, PrintJournal& orders,
                                const PrintWord& word, Nanoseconds wall) {
  if (word.decision)
    return fail(ErrorCode::Conflict,
                fmt::format("job {} is printed by a whole printer, so no layer of it is in question here; resume it "
                            "plainly, or --as start-again|treat-as-started where that is asked",
                            job.id));
  const bool goes_on = word.step == JournalStep::Approved || word.step == JournalStep::Resumed;
  if (goes_on && orders.order().order != Order::Cancel) {
    const auto journal = look_into_printer_journal(folder);
    if (!journal) return tl::unexpected{journal.error()};
    const StartFacts facts = facts_of_whole(*journal, orders, folder, job);
    const bool is_asked = !*journal || facts.is_behind_store || (*journal)->stage() == PrinterStage::StartUnknown;
    if (is_asked && !word.start) return fail(ErrorCode::Conflict, question_about_start(job.id));
    if (!is_asked && word.start)
      return fail(
          ErrorCode::Conflict,
          fmt::format("job {}: no start of it is in question; resume it without saying what came of it", job.id));
    if (is_asked) {
      auto file = open_journal_file(printer_journal_path(folder));
      if (!file) return tl::unexpected{file.error()};
      if (auto kept = keep_decision(std::move(*file), journal->has_value(), word, wall); !kept) return kept;
    }
  }
  PrintPlan plan;
  plan.job = job.id;
  PrintWord order = word;
  order.start.reset();
  return keep_word(orders, plan, LayerIndex{0}, order, wall);
}

}  // namespace

Result<void> keep_word(const std::filesystem::path& folder, const Job& job, LightOf light, const PrintWord& word,
                       Nanoseconds wall) {
  auto journal = open_journal(folder);
  if (!journal) return tl::unexpected{journal.error()};
  if (is_whole(folder, light, *journal)) return keep_word_of_whole(folder, job, *journal, word, wall);
  if (word.start)
    return fail(ErrorCode::Conflict,
                fmt::format("job {}: no start of it is in question; resume it without saying what came of it", job.id));
  PrintPlan plan;
  plan.job = job.id;
  if (word.decision) {
    const auto planned = PlannedJob::open(folder / "plan");
    if (!planned) return tl::unexpected{planned.error()};
    plan = (*planned)->plan();
  }
  return keep_word(*journal, plan, LayerIndex{job.counters.layers_printed}, word, wall);
}

Result<StartCase> start_case(const std::filesystem::path& folder, const Job& job, LightOf light) {
  StartCase found;
  found.has_begun = is_begun(job);
  std::error_code error;
  if (light == LightOf::Fab && !has_printer_journal(folder) && !std::filesystem::exists(folder / "journal", error) &&
      job.counters.layers_printed == 0)
    return found;
  const auto orders = open_journal(folder);
  if (!orders) return tl::unexpected{orders.error()};
  if (is_whole(folder, light, *orders)) {
    found.light = LightOf::WholePrinter;
    const auto journal = look_into_printer_journal(folder);
    if (!journal) return tl::unexpected{journal.error()};
    found.facts = facts_of_whole(*journal, *orders, folder, job);
    found.has_begun |= !*journal || (*journal)->stage() >= PrinterStage::StartUnknown;
    return found;
  }
  const auto planned = PlannedJob::open(folder / "plan");
  const LayerIndex seen{job.counters.layers_printed};
  found.facts = facts_of(*orders, planned ? plan_digest((*planned)->plan()) : Digest{}, seen, is_begun(job),
                         job.state == JobState::Paused);
  if (!planned) found.facts.is_of_this_plan = orders->empty();
  found.has_begun |= !orders->empty();
  found.point = resume_point_of(*orders, seen);
  return found;
}

}  // namespace telefab::fab
