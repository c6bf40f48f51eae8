// SPDX-License-Identifier: GPL-3.0-or-later
#include <fmt/format.h>

#include <telefab/fab/print/print_word.hpp>
#include <telefab/fab/print/start_rule.hpp>

namespace telefab::fab {
namespace {

/// The word and what it decides about the layers in question, as lines of the journal.
std::vector<JournalEntry> lines_of(const PrintPlan& plan, const ResumePoint& point, const PrintWord& word,
                                   Nanoseconds wall) {
  std::vector<JournalEntry> lines;
  if (word.decision == Decision::ExposeAgain)
    lines.push_back({JournalStep::DecidedExposeAgain, point.next, wall, {}, word.by, {}, {}});
  if (word.decision == Decision::TreatAsExposed)
    for (std::uint32_t k = 0; k < point.in_question && point.next.count() + k < plan.layers.size(); ++k) {
      const PlannedLayer& layer = plan.layers[point.next.count() + k];
      JournalEntry line{JournalStep::DecidedTreatAsExposed, layer.index, wall, {}, word.by, {}, {}};
      line.made.index = layer.index;
      line.made.planned = layer.exposure;
      line.made.mask = layer.mask;
      line.made.z_mm = layer.z_mm;
      line.made.note = JournalStep::DecidedTreatAsExposed;
      lines.push_back(std::move(line));
    }
  lines.push_back({word.step, point.next, wall, {}, word.by, {}, word.why});
  return lines;
}

}  // namespace

Result<void> keep_word(PrintJournal& journal, const PrintPlan& plan, LayerIndex layers_in_store, const PrintWord& word,
                       Nanoseconds wall) {
  const bool goes_on = word.step == JournalStep::Approved || word.step == JournalStep::Resumed;
  const StandingOrder standing = journal.order();
  if (standing.order == Order::Cancel) {
    if (!goes_on) return {};
    return fail(ErrorCode::Conflict, fmt::format("job {} was cancelled by {}", plan.job, standing.by));
  }
  const ResumePoint point = resume_point_of(journal, layers_in_store);
  if (goes_on && point.maybe_exposed && !word.decision)
    return fail(ErrorCode::Conflict, question_about(point, plan.job));
  if (word.decision && !point.maybe_exposed)
    return fail(ErrorCode::Conflict,
                fmt::format("job {}: no layer of it was perhaps exposed; resume it without saying what "
                            "the layer was",
                            plan.job));
  std::vector<JournalEntry> lines = lines_of(plan, point, word, wall);
  if (!journal.damage().empty()) return journal.set_aside(word.by, wall, std::move(lines));
  for (const JournalEntry& line : lines)
    if (auto kept = journal.write(line); !kept) return kept;
  return {};
}

std::string question_about_start(const std::string& job) {
  return fmt::format(
      "the printer was asked to start and nobody knows whether it did: look at it, then telefab resume {} --as "
      "treat-as-started (it prints, or has printed) | start-again (it stands idle, its platform is empty)",
      job);
}

std::string question_about(const ResumePoint& point, const std::string& job) {
  const std::uint32_t first = point.next.count();
  const std::string layers = point.in_question <= 1
                                 ? fmt::format("layer {} was", first)
                                 : fmt::format("layers {} to {} were", first, first + point.in_question - 1);
  return fmt::format("{} perhaps exposed: look at the part, then telefab resume {} --as treat-as-exposed|expose-again",
                     layers, job);
}

}  // namespace telefab::fab
