// SPDX-License-Identifier: GPL-3.0-or-later
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <telefab/fab/print/start_rule.hpp>

namespace telefab::fab {
namespace {

using namespace std::chrono_literals;
using enum StartReason;

constexpr Nanoseconds kNow = 1'000'000s;
constexpr auto kBegun = true;

StartFacts living(Nanoseconds age = 5s) {
  StartFacts facts;
  facts.order = {Order::GoOn, "ana", kNow - 1h};
  facts.last_sign = kNow - age;
  return facts;
}

template <class Change>
StartFacts but(Change change) {
  StartFacts facts = living();
  change(facts);
  return facts;
}

struct Row {
  const char* name;
  StartFacts facts;
  StartVerdict begun;      ///< of a print that was on its machine before
  StartVerdict not_begun;  ///< of a planned job
};

std::vector<Row> table() {
  const auto ruled = [](StartRuling ruling, StartReason reason) { return StartVerdict{ruling, reason}; };
  const auto both = [&](StartRuling ruling, StartReason reason) {
    return std::pair{ruled(ruling, reason), ruled(ruling, reason)};
  };
  const auto waits = [&](StartReason reason) {
    return std::pair{ruled(StartRuling::WaitForResume, reason), ruled(StartRuling::WaitForApproval, reason)};
  };
  std::vector<Row> rows;
  const auto row = [&](const char* name, StartFacts facts, std::pair<StartVerdict, StartVerdict> want) {
    rows.push_back({name, std::move(facts), want.first, want.second});
  };
  row("a crash some seconds ago", living(), both(StartRuling::GoOn, LivingOrder));
  row("just young enough", living(10min), both(StartRuling::GoOn, LivingOrder));
  row("just too old", living(10min + 1ns), waits(TooOld));
  row("three days old", living(72h), waits(TooOld));
  row("the clock went back", living(-1ns), waits(ClockWentBack));
  row("nobody's word", but([](auto& f) { f.order = {}; }), waits(NoOrder));
  row("paused", but([](auto& f) { f.order.order = Order::Pause; }), waits(Paused));
  row("paused in the store alone", but([](auto& f) { f.is_paused_in_store = true; }), waits(Paused));
  row("faulted", but([](auto& f) { f.has_faulted = true; }), waits(Faulted));
  row("faulted and so paused in the store", but([](auto& f) { f.has_faulted = f.is_paused_in_store = true; }),
      waits(Faulted));
  row("cancelled", but([](auto& f) { f.order.order = Order::Cancel; }), both(StartRuling::End, StartReason::Cancelled));
  row("cancelled, and all else wrong", but([](auto& f) {
        f.order.order = Order::Cancel;
        f.is_damaged = f.maybe_exposed = f.is_behind_store = true;
        f.is_of_this_plan = false;
      }),
      both(StartRuling::End, StartReason::Cancelled));
  row("finished", but([](auto& f) { f.is_finished = true; }), both(StartRuling::KeepRecord, Finished));
  row("finished days ago", but([](auto& f) { f.is_finished = true, f.last_sign = kNow - 72h; }),
      both(StartRuling::KeepRecord, Finished));
  row("of another plan", but([](auto& f) { f.is_of_this_plan = false; }), both(StartRuling::WaitForResume, OtherPlan));
  row("damaged in the middle", but([](auto& f) { f.is_damaged = true; }), both(StartRuling::WaitForResume, Damaged));
  row("damaged at its end", but([](auto& f) { f.is_damaged = f.maybe_exposed = true; }),
      both(StartRuling::WaitForDecision, Damaged));
  row("older than the store", but([](auto& f) { f.is_behind_store = true; }),
      both(StartRuling::WaitForDecision, BehindStore));
  row("newer than the store", but([](auto& f) { f.is_ahead_of_store = true; }),
      both(StartRuling::WaitForResume, AheadOfStore));
  row("perhaps exposed", but([](auto& f) { f.maybe_exposed = true; }),
      both(StartRuling::WaitForDecision, PerhapsExposed));
  row("perhaps exposed and paused", but([](auto& f) { f.maybe_exposed = true, f.order.order = Order::Pause; }),
      both(StartRuling::WaitForDecision, PerhapsExposed));
  // What a whole printer was asked for goes on there, whatever is done here: it is watched, and nothing is started.
  const auto at_printer = [&](auto change) {
    return but([&](auto& f) {
      f.is_at_printer = true;
      change(f);
    });
  };
  row("at its printer", at_printer([](auto&) {}), both(StartRuling::GoOn, LivingOrder));
  row("at its printer for days", at_printer([](auto& f) { f.last_sign = kNow - 72h; }),
      both(StartRuling::Watch, TooOld));
  row("paused at its printer", at_printer([](auto& f) { f.order.order = Order::Pause; }),
      both(StartRuling::Watch, Paused));
  row("cancelled at its printer", at_printer([](auto& f) { f.order.order = Order::Cancel; }),
      both(StartRuling::Watch, StartReason::Cancelled));
  row("at its printer, of another plan", at_printer([](auto& f) { f.is_of_this_plan = false; }),
      both(StartRuling::WaitForResume, OtherPlan));
  return rows;
}

TEST(StartRule, RulesByWhoseWordHowOldAndAfterWhichStop) {
  for (const Row& row : table()) {
    SCOPED_TRACE(row.name);
    EXPECT_EQ(may_light_at_start(row.facts, kBegun, {}, kNow), row.begun)
        << name_of(may_light_at_start(row.facts, kBegun, {}, kNow).reason);
    EXPECT_EQ(may_light_at_start(row.facts, !kBegun, {}, kNow), row.not_begun)
        << name_of(may_light_at_start(row.facts, !kBegun, {}, kNow).reason);
  }
}

TEST(StartRule, LightsNothingByItselfWhereItIsToAsk) {
  StartPolicy ask;
  ask.go_on = false;
  for (const Row& row : table()) EXPECT_NE(may_light_at_start(row.facts, kBegun, ask, kNow).ruling, StartRuling::GoOn);
  EXPECT_EQ(may_light_at_start(living(), kBegun, ask, kNow).reason, AlwaysAsk);
}

TEST(StartRule, GoesOnWithALayerInQuestionOnlyOnAStatedPolicyAndThenByTheSameRule) {
  StartPolicy policy;
  policy.maybe_exposed = Decision::ExposeAgain;
  StartFacts facts = living();
  facts.maybe_exposed = true;
  EXPECT_EQ(may_light_at_start(facts, kBegun, policy, kNow).ruling, StartRuling::GoOn);
  facts.last_sign = kNow - 1h;
  EXPECT_EQ(may_light_at_start(facts, kBegun, policy, kNow).reason, TooOld);
  facts.order.order = Order::Pause;
  EXPECT_EQ(may_light_at_start(facts, kBegun, policy, kNow).reason, Paused);
  facts = living();
  facts.maybe_exposed = facts.is_behind_store = true;
  EXPECT_EQ(may_light_at_start(facts, kBegun, policy, kNow).ruling, StartRuling::WaitForDecision)
      << "a policy speaks of a layer under way, not of layers that a backup has lost";
}

TEST(StartRule, GoesOnOnlyWithALivingOrderWhateverElseIsTrue) {
  for (unsigned bits = 0; bits < 512; ++bits)
    for (const Order order : {Order::None, Order::GoOn, Order::Pause, Order::Cancel})
      for (const Nanoseconds age : {Nanoseconds{-1h}, Nanoseconds{0}, Nanoseconds{10min}, Nanoseconds{11min}})
        for (const bool may_guess : {false, true}) {
          StartFacts f = living(age);
          f.order.order = order;
          f.is_finished = bits & 1U, f.has_faulted = bits & 2U, f.is_of_this_plan = bits & 4U, f.is_damaged = bits & 8U;
          f.is_behind_store = bits & 16U, f.maybe_exposed = bits & 32U, f.is_paused_in_store = bits & 64U;
          f.is_ahead_of_store = bits & 128U, f.is_at_printer = bits & 256U;
          StartPolicy policy;
          if (may_guess) policy.maybe_exposed = Decision::TreatAsExposed;
          const StartVerdict verdict = may_light_at_start(f, kBegun, policy, kNow);
          if (verdict.ruling == StartRuling::GoOn) {
            EXPECT_EQ(order, Order::GoOn);
            EXPECT_TRUE(age >= 0s && age <= 10min);
            EXPECT_EQ(bits & ~(4U | 32U | 256U), 0U) << bits;
            EXPECT_TRUE(may_guess || !f.maybe_exposed);
          }
          if (order == Order::Cancel) {
            EXPECT_EQ(verdict.ruling, f.is_at_printer ? StartRuling::Watch : StartRuling::End);
          }
          if (verdict.ruling == StartRuling::Watch) {
            EXPECT_TRUE(f.is_at_printer);
            continue;
          }
          const bool waits = verdict.ruling == StartRuling::WaitForResume ||
                             verdict.ruling == StartRuling::WaitForApproval ||
                             verdict.ruling == StartRuling::WaitForDecision;
          EXPECT_EQ(waits, !sentence_of(verdict).empty());
        }
}

// ---- the facts -----------------------------------------------------------------------------------------------------

JournalEntry line(JournalStep step, std::uint32_t layer, Nanoseconds wall = 1s) {
  JournalEntry e;
  e.step = step;
  e.layer = LayerIndex{layer};
  e.wall = wall;
  return e;
}

PrintJournal journal_of(const std::vector<JournalEntry>& lines) {
  auto journal = *PrintJournal::open(memory_journal_file());
  for (const JournalEntry& e : lines) EXPECT_TRUE(journal.write(e));
  return journal;
}

TEST(StartFacts, TakesTheNewestWordForTheOrder) {
  using enum JournalStep;
  const auto order_of = [](const std::vector<JournalEntry>& lines) { return journal_of(lines).order().order; };
  EXPECT_EQ(order_of({}), Order::None);
  EXPECT_EQ(order_of({line(Approved, 0)}), Order::GoOn);
  EXPECT_EQ(order_of({line(Approved, 0), line(JournalStep::PauseAsked, 2)}), Order::Pause);
  EXPECT_EQ(order_of({line(Approved, 0), line(JournalStep::PauseAsked, 2), line(Resumed, 2)}), Order::GoOn);
  EXPECT_EQ(order_of({line(Approved, 0), line(JournalStep::CancelAsked, 2), line(Resumed, 2)}), Order::Cancel)
      << "no word undoes a cancel";
  JournalEntry by_policy = line(DecidedTreatAsExposed, 2), by_ana = by_policy;
  by_policy.by = "policy", by_ana.by = "ana";
  EXPECT_EQ(order_of({line(Approved, 0), line(JournalStep::PauseAsked, 2), by_policy}), Order::Pause);
  EXPECT_EQ(order_of({line(Approved, 0), line(JournalStep::PauseAsked, 2), by_ana}), Order::GoOn);
}

TEST(StartFacts, SeesABackupByTheLayersTheStoreHasSeen) {
  using enum JournalStep;
  const PrintJournal journal = journal_of({line(Approved, 0), line(Planned, 0), line(JournalStep::Exposing, 0),
                                           line(Exposed, 0), line(JournalStep::Exposing, 1), line(Exposed, 1)});
  const auto facts = [&](std::uint32_t seen) { return facts_of(journal, {}, LayerIndex{seen}, true, false); };
  EXPECT_FALSE(facts(2).is_behind_store);
  EXPECT_FALSE(facts(1).is_behind_store) << "the store is written less often";
  EXPECT_TRUE(facts(3).is_behind_store);
  EXPECT_EQ(resume_point_of(journal, LayerIndex{5}), (ResumePoint{LayerIndex{2}, true, 3}));
  EXPECT_EQ(resume_point_of(journal, LayerIndex{2}), (ResumePoint{LayerIndex{2}, false}));
  EXPECT_TRUE(facts_of(journal, {}, LayerIndex{0}, false, false).is_ahead_of_store);
  EXPECT_EQ(facts(2).last_sign, 1s);
}

TEST(StartFacts, TakeTheAgeOfThePrintByItsNewestLineThoughTheClockWasSetBackMeanwhile) {
  JournalEntry before = line(JournalStep::PauseAsked, 0), after = line(JournalStep::Resumed, 0);
  before.wall = 100h;
  after.wall = 99h;  // somebody looked at it and resumed it an hour "earlier"
  const PrintJournal journal = journal_of({line(JournalStep::Approved, 0), before, after});
  StartFacts facts = facts_of(journal, {}, LayerIndex{0}, true, false);
  EXPECT_EQ(facts.last_sign, 99h);
  facts.is_of_this_plan = true;
  EXPECT_EQ(may_light_at_start(facts, true, {}, 100h + 5min).reason, StartReason::TooOld) << "it hung for over an hour";
}

}  // namespace
}  // namespace telefab::fab
