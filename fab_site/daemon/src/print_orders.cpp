// SPDX-License-Identifier: GPL-3.0-or-later
#include "print_orders.hpp"

#include <telefab/fab/planning/plan_folder.hpp>

namespace telefab::fab {
namespace {

Result<PrintJournal> open_journal(const std::filesystem::path& folder) {
  auto file = open_journal_file(folder / "journal");
  if (!file) return tl::unexpected{file.error()};
  return PrintJournal::open(std::move(*file));
}

bool is_begun(const Job& job) { return !is_before(job.state, JobState::Printing) || job.counters.layers_printed > 0; }

}  // namespace

Result<void> keep_word(const std::filesystem::path& folder, const Job& job, const PrintWord& word, Nanoseconds wall) {
  auto journal = open_journal(folder);
  if (!journal) return tl::unexpected{journal.error()};
  PrintPlan plan;
  plan.job = job.id;
  if (word.decision) {
    const auto planned = PlannedJob::open(folder / "plan");
    if (!planned) return tl::unexpected{planned.error()};
    plan = (*planned)->plan();
  }
  return keep_word(*journal, plan, LayerIndex{job.counters.layers_printed}, word, wall);
}

Result<StartCase> start_case(const std::filesystem::path& folder, const Job& job) {
  StartCase found;
  found.has_begun = is_begun(job);
  std::error_code error;
  if (!std::filesystem::exists(folder / "journal", error) && job.counters.layers_printed == 0) return found;
  const auto journal = open_journal(folder);
  if (!journal) return tl::unexpected{journal.error()};
  const auto planned = PlannedJob::open(folder / "plan");
  const LayerIndex seen{job.counters.layers_printed};
  found.facts = facts_of(*journal, planned ? plan_digest((*planned)->plan()) : Digest{}, seen, is_begun(job),
                         job.state == JobState::Paused);
  if (!planned) found.facts.is_of_this_plan = journal->empty();
  found.has_begun |= !journal->empty();
  found.point = resume_point_of(*journal, seen);
  return found;
}

}  // namespace telefab::fab
