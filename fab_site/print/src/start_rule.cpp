// SPDX-License-Identifier: GPL-3.0-or-later
#include <algorithm>
#include <telefab/fab/print/start_rule.hpp>

namespace telefab::fab {

StartVerdict may_light_at_start(const StartFacts& facts, bool begun, const StartPolicy& policy, Nanoseconds wall) {
  using enum StartReason;
  const auto wait = [&](StartReason why) {
    return StartVerdict{begun ? StartRuling::WaitForResume : StartRuling::WaitForApproval, why};
  };
  // An answered cancel stands whatever else is wrong.
  if (facts.order.order == Order::Cancel)
    return {facts.is_at_printer ? StartRuling::Watch : StartRuling::End, Cancelled};  // its printer is to be stopped
  if (!facts.is_of_this_plan) return {StartRuling::WaitForResume, OtherPlan};
  if (facts.is_finished && !facts.is_damaged) return {StartRuling::KeepRecord, Finished};

  const StartRuling asked = facts.maybe_exposed ? StartRuling::WaitForDecision : StartRuling::WaitForResume;
  if (facts.is_damaged) return {asked, Damaged};
  if (facts.is_behind_store) return {StartRuling::WaitForDecision, BehindStore};
  if (facts.is_ahead_of_store) return {asked, AheadOfStore};
  if (facts.maybe_exposed && !policy.maybe_exposed) return {StartRuling::WaitForDecision, PerhapsExposed};

  const StartVerdict verdict = [&]() -> StartVerdict {
    if (facts.order.order == Order::Pause || facts.is_paused_in_store)
      return wait(facts.has_faulted && facts.order.order != Order::Pause ? Faulted : Paused);
    if (facts.order.order == Order::None) return wait(NoOrder);
    if (facts.has_faulted) return wait(Faulted);
    if (!policy.go_on) return wait(AlwaysAsk);
    const Nanoseconds age = wall - facts.last_sign;
    if (age < Nanoseconds{0}) return wait(ClockWentBack);
    if (age > policy.within) return wait(TooOld);
    return {StartRuling::GoOn, LivingOrder};
  }();
  if (facts.is_at_printer && verdict.ruling != StartRuling::GoOn) return {StartRuling::Watch, verdict.reason};
  return verdict;
}

std::string_view name_of(StartRuling ruling) {
  static constexpr std::string_view names[] = {
      "go-on", "wait-for-approval", "wait-for-resume", "wait-for-decision", "end", "keep-record", "watch"};
  return names[static_cast<std::size_t>(ruling)];
}

std::string_view name_of(StartReason reason) {
  static constexpr std::string_view names[] = {
      "living-order",    "cancelled", "finished", "other-plan", "damaged",    "behind-store",    "ahead-of-store",
      "perhaps-exposed", "paused",    "no-order", "faulted",    "always-ask", "clock-went-back", "too-old"};
  static_assert(std::size(names) == static_cast<std::size_t>(StartReason::TooOld) + 1);
  return names[static_cast<std::size_t>(reason)];
}

std::string sentence_of(const StartVerdict& verdict) {
  switch (verdict.reason) {
    case StartReason::LivingOrder:
    case StartReason::Cancelled:
    case StartReason::Finished:
      return {};
    case StartReason::OtherPlan:
      return "the print journal belongs to another plan than the one beside it; put the right plan back, or cancel";
    case StartReason::Damaged:
      return "the print journal is damaged; look at the part before it goes on";
    case StartReason::BehindStore:
      return "the print journal is older than what this site saw of the print, as after a restored backup; look at the "
             "part";
    case StartReason::AheadOfStore:
      return "the print journal tells of a print of which the job list knows nothing, as after a restored backup; look "
             "at the part";
    case StartReason::PerhapsExposed:
      return "a layer was perhaps exposed when the print broke off";
    case StartReason::Paused:
      return "it was paused when the site ended";
    case StartReason::NoOrder:
      return "nobody's word to print it is kept";
    case StartReason::Faulted:
      return "it had faulted when the site ended";
    case StartReason::AlwaysAsk:
      return "the site was started again, and its prints wait then (--after-restart ask)";
    case StartReason::ClockWentBack:
      return "the computer's clock is behind the print journal, so nobody knows how long the part hung";
    case StartReason::TooOld:
      return "the site was away for longer than prints go on by themselves (--go-on-within-min)";
  }
  return {};
}

ResumePoint resume_point_of(const PrintJournal& journal, LayerIndex layers_in_store) {
  ResumePoint point = journal.resume_point();
  if (layers_in_store > point.next) {
    point.in_question = std::max(point.maybe_exposed ? point.in_question : 0, (layers_in_store - point.next).count());
    point.maybe_exposed = true;
  }
  return point;
}

StartFacts facts_of(const PrintJournal& journal, const Digest& plan, LayerIndex layers_in_store, bool is_begun_in_store,
                    bool is_paused_in_store) {
  StartFacts facts;
  const auto& entries = journal.entries();
  facts.order = journal.order();
  facts.is_finished = journal.finished();
  facts.has_faulted = !entries.empty() && entries.back().step == JournalStep::Faulted;
  facts.is_of_this_plan = journal.belongs_to(plan).has_value();
  facts.is_damaged = !journal.damage().empty();
  const ResumePoint known = journal.resume_point();
  // The store counts a layer when its exposure has ended or is in question.
  facts.is_behind_store = layers_in_store > known.next;
  facts.is_ahead_of_store = !journal.empty() && !is_begun_in_store;
  facts.maybe_exposed = known.maybe_exposed || facts.is_behind_store;
  facts.is_paused_in_store = is_paused_in_store;
  // The newest line, not the latest time: where the clock was set back, older lines are of a time yet to come.
  if (!entries.empty()) facts.last_sign = entries.back().wall;
  return facts;
}

StartFacts facts_of(const PrinterJournal* journal, const PrintJournal& orders, const Digest& plan,
                    LayerIndex layers_in_store, bool is_begun_in_store, bool is_paused_in_store) {
  StartFacts facts;
  facts.order = orders.order();
  facts.maybe_exposed = journal == nullptr;  // nobody knows what its printer made of it
  facts.is_damaged = journal == nullptr || !orders.damage().empty();
  facts.is_paused_in_store = is_paused_in_store;
  if (!orders.entries().empty()) facts.last_sign = orders.entries().back().wall;
  if (journal == nullptr) return facts;
  const PrinterStage stage = journal->stage();
  const PrinterJournalEntry* planned = journal->last(PrinterStep::Planned);
  facts.is_of_this_plan = planned == nullptr || planned->plan == plan;
  facts.is_finished = stage == PrinterStage::Finished;
  if (facts.is_finished) facts.order = {};  // what is over obeys no order
  facts.is_at_printer = stage == PrinterStage::StartUnknown || stage == PrinterStage::Printing;
  // Layers are seen at the printer alone, so it was asked; an operator who decided has answered that.
  facts.is_behind_store = layers_in_store.count() > 0 && journal->last(PrinterStep::Starting) == nullptr &&
                          journal->last(PrinterStep::DecidedStartAgain) == nullptr &&
                          journal->last(PrinterStep::DecidedTreatAsStarted) == nullptr;
  facts.is_ahead_of_store = stage >= PrinterStage::StartUnknown && !is_begun_in_store;
  if (!journal->entries().empty()) facts.last_sign = std::max(facts.last_sign, journal->entries().back().wall);
  return facts;
}

}  // namespace telefab::fab
