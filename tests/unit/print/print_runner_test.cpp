// SPDX-License-Identifier: GPL-3.0-or-later
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <telefab/fab/device/virtual_projector.hpp>
#include <telefab/fab/device/virtual_z_stage.hpp>
#include <telefab/fab/print/print_runner.hpp>
#include <telefab/fab/print/print_time.hpp>
#include <telefab/test/layer_motions.hpp>

namespace telefab::fab {
namespace {

using namespace std::chrono_literals;

constexpr PixelSize kSize{8, 6};

class StripedMasks final : public MaskSource {
 public:
  Result<Mask> mask(LayerIndex layer) override {
    Mask m{kSize, std::vector<std::uint8_t>(48, static_cast<std::uint8_t>(layer.count()))};
    if (spoilt == layer) m.rows[0] ^= 1;
    return m;
  }
  std::optional<LayerIndex> spoilt;
};

/// Every step there is.
LayerMotion test_motion() { return test::every_step_and_tilt(); }
const LayerMotion kMotions[] = {{}, test::every_step(), test::every_step_and_tilt(), test::tilt_alone()};

/// Where something goes on, with every_step_and_tilt().
constexpr PrintPhase kAtWork[] = {PrintPhase::Homing,   PrintPhase::Lowering, PrintPhase::Settling,
                                  PrintPhase::Exposing, PrintPhase::Resting,  PrintPhase::Tilting,
                                  PrintPhase::Lifting,  PrintPhase::Draining};

struct Bench {
  explicit Bench(std::uint32_t layers = 6, double acceleration_mm_per_s2 = 0)
      : stage{25, clock, log, {.acceleration_mm_per_s2 = acceleration_mm_per_s2}} {
    plan.acceleration_mm_per_s2 = acceleration_mm_per_s2;
    plan.job = "j1";
    plan.machine = "m";
    plan.mask_size = kSize;
    plan.z_travel_mm = 20;
    for (std::uint32_t i = 0; i < layers; ++i)
      plan.layers.push_back(
          {LayerIndex{i}, 0.1 * (i + 1), 700ms, digest_of(std::as_bytes(std::span{masks.mask(LayerIndex{i})->rows}))});
  }
  PrintRecord print(PrintSink sink = {}, PrintPolicy policy = {}) {
    PrintRunner runner{projector, stage, masks, journal, clock, &sensors};
    auto record = runner.run(plan, policy, control, sink, stop.get_token());
    EXPECT_TRUE(record) << (record ? "" : record.error().what);
    return record ? *record : PrintRecord{};
  }
  void move_as(const LayerMotion& motion) {
    for (PlannedLayer& layer : plan.layers) layer.motion = motion;
  }
  [[nodiscard]] StagePace pace() const { return {stage.facts().highest_mm, stage.facts().homing_mm_per_s}; }
  PrintPlan plan;
  StripedMasks masks;
  VirtualClock clock;
  MachineLog log;
  VirtualProjector projector{kSize, 0, clock, log};
  VirtualZStage stage;
  VirtualSensors sensors;
  PrintJournal journal = *PrintJournal::open(memory_journal_file());
  PrintControl control;
  std::stop_source stop;
};

void expect_every_layer_once(const Bench& b) {
  const auto light = b.log.light();
  std::size_t lit = 0;
  for (const PlannedLayer& layer : b.plan.layers) {
    if (layer.exposure == 0us) continue;
    ASSERT_LT(lit, light.size());
    EXPECT_EQ(light[lit].mask, layer.mask);
    EXPECT_NEAR(light[lit].z_mm, layer.z_mm, 1e-9);
    EXPECT_EQ(light[lit].until - light[lit].from, Nanoseconds{layer.exposure});
    ++lit;
  }
  EXPECT_EQ(lit, light.size());
  EXPECT_EQ(b.log.light_while_moving(), 0ns);
}

TEST(PrintRunner, ShowsEveryMaskOnceAtItsHeightForItsTime) {
  Bench b;
  b.plan.layers[2].exposure = 0us;
  const PrintRecord record = b.print();
  EXPECT_EQ(record.outcome, PrintOutcome::Done) << record.cause.what;
  expect_every_layer_once(b);
  EXPECT_THAT(compare(record, b.plan), testing::IsEmpty());
}

TEST(PrintRunner, TakesTheTimeItWasEstimatedToTakeWhateverTheMotion) {
  for (const LayerMotion& motion : kMotions)
    for (const double acceleration : {0.0, 20.0}) {
      Bench b{40, acceleration};
      b.move_as(motion);
      const std::vector<Nanoseconds> left = time_left(b.plan, b.pace());
      std::vector<std::pair<Nanoseconds, Nanoseconds>> listed;
      EXPECT_EQ(b.print([&](const PrintProgress& p) {
                   if (p.phase == PrintPhase::Exposing) listed.emplace_back(b.clock.now(), p.left);
                 }).outcome,
                PrintOutcome::Done);
      const Nanoseconds took = b.clock.now();
      EXPECT_NEAR(double(took.count()) / double(print_time(b.plan, {}, b.pace(), {}).count()), 1, 0.02);
      ASSERT_EQ(listed.size(), 40u);
      // At the beginning of an exposure its layer's approach is over already.
      for (std::size_t k = 0; k < listed.size(); ++k) {
        EXPECT_EQ(listed[k].second, left[k]);
        const double still = double((listed[k].second - approach_time(b.plan, LayerIndex{std::uint32_t(k)})).count());
        EXPECT_NEAR(double((took - listed[k].first).count()) * 1e-9, still * 1e-9, 0.02 * double(took.count()) * 1e-9);
      }
    }
}

TEST(PrintRunner, MovesAndWaitsAroundALayerAsItsPlanSays) {
  Bench b{3};
  b.move_as(test_motion());
  b.print();
  const auto light = b.log.light();
  const auto moves = b.log.moves();
  ASSERT_EQ(light.size(), 3u);
  const auto behind =
      std::find_if(moves.begin(), moves.end(), [&](const MoveSpan& m) { return m.from >= light[0].until; });
  ASSERT_GE(moves.end() - behind, 5);
  const auto near = [](Nanoseconds wait, double seconds) { EXPECT_NEAR(double(wait.count()) * 1e-9, seconds, 0.025); };
  near(behind[0].from - light[0].until, 0.3);  // firm
  EXPECT_EQ(behind[0].until - behind[0].from, 1100ms) << "the vat tips";
  EXPECT_EQ(behind[0].z_from_mm, behind[0].z_to_mm);
  EXPECT_NEAR(behind[1].z_to_mm, 0.1 + 1.5, 1e-9);
  EXPECT_EQ(behind[1].until - behind[1].from, 1500ms) << "slow peel";
  EXPECT_NEAR(behind[2].z_to_mm, 0.1 + 5, 1e-9);
  EXPECT_NEAR(double((behind[2].until - behind[2].from).count()), 1.75e9, 1e3);
  EXPECT_EQ(behind[2].from, behind[1].until) << "no rest between the parts";
  near(behind[3].from - behind[2].until, 0.6);  // resin flows back
  EXPECT_NEAR(behind[3].z_to_mm, 0.2 + 1, 1e-9);
  EXPECT_NEAR(behind[4].z_to_mm, 0.2, 1e-9);
  EXPECT_EQ(behind[4].until - behind[4].from, 1000ms) << "slow approach";
  near(light[1].from - behind[4].until, 0.4);  // rest
}

TEST(PrintRunner, ShowsEachLayerAtItsShareOfTheLight) {
  Bench b{4};
  b.plan.layers[1].light_share = 0.2;
  b.plan.layers[2].light_share = 0.6;
  EXPECT_EQ(b.print().outcome, PrintOutcome::Done);
  std::vector<double> shares;
  for (const LitSpan& lit : b.log.light()) shares.push_back(lit.share);
  EXPECT_EQ(shares, (std::vector<double>{1, 0.2, 0.6, 1}));
}

TEST(PrintRunner, NeverRestsLongerThanTheVatTipsWithoutALift) {
  Bench b{4};
  LayerMotion motion;
  motion.lift_mm = 0;
  motion.tilt_s = 2;
  b.move_as(motion);
  int pauses = 0;
  const PrintRecord record = b.print([&](const PrintProgress& p) {
    if (p.phase == PrintPhase::Tilting && p.layer == LayerIndex{2} && pauses == 0) b.control.pause();
    if (p.phase != PrintPhase::Paused) return;
    ++pauses;
    EXPECT_EQ(b.log.z_mm(), b.stage.facts().highest_mm) << "a pause leaves no part in the resin";
    b.control.resume();
  });
  EXPECT_EQ(record.outcome, PrintOutcome::Done) << record.cause.what;
  EXPECT_EQ(pauses, 1);
  expect_every_layer_once(b);
}

TEST(PrintRunner, PausesLiftedAndGoesOnWithTheNextLayer) {
  Bench b;
  int pauses = 0;
  b.print([&](const PrintProgress& p) {
    if (p.phase == PrintPhase::Exposing && p.layer == LayerIndex{2} && pauses == 0) b.control.pause();
    if (p.phase == PrintPhase::Paused) {
      ++pauses;
      EXPECT_GT(b.log.z_mm(), b.plan.layers[2].z_mm + 4.9);
      b.control.resume();
    }
  });
  EXPECT_EQ(pauses, 1);
  expect_every_layer_once(b);
}

TEST(PrintRunner, PausesFromEveryStateAndStillPrintsEveryLayerOnce) {
  for (const PrintPhase where : kAtWork) {
    SCOPED_TRACE(name_of(where));
    Bench b;
    b.move_as(test_motion());
    int pauses = 0;
    const PrintRecord record = b.print([&](const PrintProgress& p) {
      if (p.phase == where && pauses == 0) b.control.pause();
      if (p.phase == PrintPhase::Paused) {
        ++pauses;
        b.control.resume();
      }
    });
    EXPECT_EQ(pauses, 1);
    EXPECT_EQ(record.outcome, PrintOutcome::Done);
    expect_every_layer_once(b);
  }
}

TEST(PrintRunner, CancelsDarkAtOnceFromEveryState) {
  for (const PrintPhase where : kAtWork) {
    SCOPED_TRACE(name_of(where));
    Bench b;
    b.move_as(test_motion());
    Nanoseconds asked{};
    const PrintRecord record = b.print([&](const PrintProgress& p) {
      if (p.phase == where && asked == 0ns) {
        b.control.cancel();
        asked = b.clock.now();
      }
    });
    EXPECT_EQ(record.outcome, PrintOutcome::Cancelled);
    for (const LitSpan& lit : b.log.light()) EXPECT_TRUE(lit.from < asked || lit.until - asked <= 60ms);
    EXPECT_EQ(b.log.light_while_moving(), 0ns);
  }
}

TEST(PrintRunner, ShowsNothingWhenAMaskIsNotThePlannedOne) {
  Bench b;
  b.masks.spoilt = LayerIndex{3};
  const PrintRecord record = b.print();
  EXPECT_EQ(record.outcome, PrintOutcome::Faulted);
  EXPECT_EQ(record.cause.code, ErrorCode::NotTrusted);
  EXPECT_EQ(record.next, LayerIndex{3});
  EXPECT_EQ(b.log.light().size(), 3u);
}

TEST(PrintRunner, RecoversFromDarkFaultsWithTheRightDose) {
  Bench b;
  b.projector.faults.refuse_load_at = 2;
  b.stage.faults.stall_at = 7;
  const PrintRecord record = b.print();
  EXPECT_EQ(record.outcome, PrintOutcome::Done) << record.cause.what;
  expect_every_layer_once(b);
}

TEST(PrintRunner, StopsResumableWhenALayerWasPerhapsExposed) {
  Bench b;
  b.projector.faults.lose_at_expose = 2;
  PrintRecord record = b.print();
  EXPECT_EQ(record.outcome, PrintOutcome::Faulted);
  EXPECT_TRUE(record.maybe_exposed);
  EXPECT_EQ(record.next, LayerIndex{2});
  PrintPolicy decided;
  decided.maybe_exposed = Decision::TreatAsExposed;  // the projector timed it by itself
  record = b.print({}, decided);
  EXPECT_EQ(record.outcome, PrintOutcome::Done);
  EXPECT_EQ(record.runs, 2u);
  expect_every_layer_once(b);
}

TEST(PrintRunner, WaitsForTheOperatorWhenNoPolicyDecides) {
  Bench b;
  b.projector.faults.ignore_expose_at = 1;
  EXPECT_TRUE(b.print().maybe_exposed);
  const PrintRecord record = b.print([&](const PrintProgress& p) {
    if (p.phase == PrintPhase::AwaitingDecision) b.control.decide(Decision::ExposeAgain, "ana");
  });
  EXPECT_EQ(record.outcome, PrintOutcome::Done);
  expect_every_layer_once(b);
}

TEST(PrintRunner, GoesDarkWhenTheCoverIsOpenedAndWhenTheResinIsOutsideItsLimits) {
  for (const bool hot : {false, true}) {
    Bench b;
    PrintPolicy policy;
    policy.hottest_celsius = 45;
    const PrintRecord record = b.print(
        [&](const PrintProgress& p) {
          if (p.phase != PrintPhase::Exposing || p.layer != LayerIndex{1}) return;
          b.sensors.reading.interlock_open = !hot;
          if (hot) b.sensors.reading.resin_celsius = 50;
        },
        policy);
    EXPECT_EQ(record.outcome, PrintOutcome::Faulted);
    EXPECT_EQ(record.cause.code, ErrorCode::NotPermitted);
    EXPECT_LE(b.log.light().back().until - b.log.light().back().from, 60ms);
  }
}

TEST(PrintRunner, SaysThatTheLightMayBeOnWhenTheProjectorDoesNotAnswer) {
  Bench b;
  const PrintRecord record = b.print([&](const PrintProgress& p) {
    if (p.phase != PrintPhase::Exposing || p.layer != LayerIndex{1}) return;
    b.projector.faults.refuse_dark = 100;
    b.control.cancel();
  });
  EXPECT_THAT(record.cause.what, testing::HasSubstr("LIGHT MAY STILL BE ON"));
}

TEST(PrintRunner, StopsDarkAndResumableWhenTheSiteStops) {
  Bench b;
  const PrintRecord record = b.print([&](const PrintProgress& p) {
    if (p.phase == PrintPhase::Lowering && p.layer == LayerIndex{3}) b.stop.request_stop();
  });
  EXPECT_EQ(record.outcome, PrintOutcome::Faulted);
  EXPECT_EQ(record.cause.code, ErrorCode::Cancelled);
  b.stop = {};
  EXPECT_EQ(b.print().outcome, PrintOutcome::Done);
  expect_every_layer_once(b);
}

TEST(PrintRunner, LetsTheLightEndWhenTheSiteStopsAndGuessesAboutNoLayer) {
  for (const Nanoseconds after : {0ns, Nanoseconds{300ms}, Nanoseconds{690ms}}) {
    SCOPED_TRACE(after.count());
    Bench b;
    const PrintRecord record = b.print([&](const PrintProgress& p) {
      if (p.phase != PrintPhase::Exposing || p.layer != LayerIndex{2}) return;
      b.clock.advance(after);
      b.stop.request_stop();
    });
    EXPECT_EQ(record.outcome, PrintOutcome::Faulted);
    EXPECT_EQ(record.cause.code, ErrorCode::Cancelled);
    EXPECT_FALSE(record.maybe_exposed);
    EXPECT_EQ(record.next, LayerIndex{3});
    EXPECT_EQ(b.journal.entries().back().step, JournalStep::Stopped);
    EXPECT_EQ(b.journal.resume_point(), (ResumePoint{LayerIndex{3}, false}));
    ASSERT_EQ(b.log.light().size(), 3u);
    EXPECT_EQ(b.log.light().back().until - b.log.light().back().from, 700ms);
    b.stop = {};
    EXPECT_EQ(b.print().outcome, PrintOutcome::Done);
    expect_every_layer_once(b);
  }
}

TEST(PrintRunner, RaisesThePartOfAPrintThatBrokeOffBehindItsLastLayer) {
  Bench b;
  const PrintRecord record = b.print([&](const PrintProgress& p) {
    if (p.phase == PrintPhase::Finishing) b.stop.request_stop();
  });
  EXPECT_EQ(record.outcome, PrintOutcome::Faulted);
  EXPECT_FALSE(record.maybe_exposed);
  b.stop = {};
  EXPECT_EQ(b.print().outcome, PrintOutcome::Done);
  EXPECT_NEAR(b.log.z_mm(), 25, 1e-9);
  EXPECT_TRUE(b.journal.finished());
  expect_every_layer_once(b);
}

TEST(PrintRunner, GoesDarkAtOnceWhenTheRestOfTheLightIsLongerThanAStopMayTake) {
  Bench b;
  PrintPolicy policy;
  policy.longest_last_light = 200ms;
  const PrintRecord record = b.print(
      [&](const PrintProgress& p) {
        if (p.phase == PrintPhase::Exposing && p.layer == LayerIndex{2}) b.stop.request_stop();
      },
      policy);
  EXPECT_TRUE(record.maybe_exposed);
  EXPECT_EQ(record.next, LayerIndex{2});
  EXPECT_EQ(b.journal.entries().back().step, JournalStep::Stopped);
  EXPECT_LE(b.log.light().back().until - b.log.light().back().from, 60ms);
}

TEST(PrintRunner, StaysUnknownWhenTheSiteStopsBeforeADecision) {
  Bench b;
  b.projector.faults.ignore_expose_at = 1;
  EXPECT_TRUE(b.print().maybe_exposed);
  const PrintRecord record = b.print([&](const PrintProgress& p) {
    if (p.phase == PrintPhase::AwaitingDecision) b.stop.request_stop();
  });
  EXPECT_TRUE(record.maybe_exposed);
  EXPECT_TRUE(b.journal.resume_point().maybe_exposed);
}

TEST(PrintRunner, FollowsTheOperatorBeforeThePolicyAndNamesWhoDecided) {
  for (const bool by_operator : {false, true}) {
    SCOPED_TRACE(by_operator);
    Bench b;
    b.projector.faults.ignore_expose_at = 1;
    EXPECT_TRUE(b.print().maybe_exposed);
    PrintPolicy policy;
    policy.maybe_exposed = by_operator ? Decision::TreatAsExposed : Decision::ExposeAgain;
    if (by_operator) b.control.decide(Decision::ExposeAgain, "ana");
    const PrintRecord record = b.print({}, policy);
    EXPECT_EQ(record.outcome, PrintOutcome::Done);
    expect_every_layer_once(b);
    EXPECT_EQ(record.layers.at(1).decided, by_operator ? "again: ana" : "again: policy");
    EXPECT_EQ(record.layers.at(0).decided, "");
    EXPECT_EQ(*print_record_from_json(to_json(record)), record);
  }
}

TEST(PrintRunner, KeepsEveryDecisionAboutALayerInItsOrder) {
  Bench b;
  b.projector.faults.ignore_expose_at = 1;
  EXPECT_TRUE(b.print().maybe_exposed);
  PrintPolicy decided;
  decided.maybe_exposed = Decision::ExposeAgain;
  decided.recoveries = 0;
  b.projector.faults.lose_at_expose = 2;
  EXPECT_TRUE(b.print({}, decided).maybe_exposed);
  b.control.decide(Decision::TreatAsExposed, "ana");
  const PrintRecord record = b.print();
  EXPECT_EQ(record.outcome, PrintOutcome::Done);
  EXPECT_EQ(record.layers.at(1).decided, "again: policy; exposed: ana");
  EXPECT_EQ(record.layers.at(1).note, JournalStep::DecidedTreatAsExposed);
}

TEST(PrintRunner, ForgetsADecisionAboutNothing) {
  Bench b;
  b.control.decide(Decision::TreatAsExposed, "ana");
  const PrintRecord record = b.print();
  EXPECT_EQ(record.outcome, PrintOutcome::Done);
  expect_every_layer_once(b);
}

TEST(PrintRunner, GivesTheRecordOfAFinishedJobAgainAndRefusesAJournalOfAnotherPlan) {
  Bench b;
  const PrintRecord record = b.print();
  const Nanoseconds ended = b.clock.now();
  PrintRunner runner{b.projector, b.stage, b.masks, b.journal, b.clock};
  const auto again = runner.run(b.plan, {}, b.control, {}, {});
  ASSERT_TRUE(again) << again.error().what;
  EXPECT_EQ(*again, record);
  EXPECT_EQ(b.clock.now(), ended) << "nothing moved";
  expect_every_layer_once(b);
  b.plan.layers[0].exposure = 800ms;
  EXPECT_EQ(runner.run(b.plan, {}, b.control, {}, {}).error().code, ErrorCode::NotTrusted);
}

// ---- the fence ------------------------------------------------------------------------------------------------------

/// Answers by a plan: of each question, counted from 0.
class PlannedFence final : public LightFence {
 public:
  explicit PlannedFence(std::function<Leave(int question)> answer) : answer_{std::move(answer)} {}
  std::uint32_t attempt() const override { return 2; }
  Leave leave(LayerIndex) override { return answer_(questions++); }
  int questions = 0;

 private:
  std::function<Leave(int)> answer_;
};
const Leave kNewer{LeaveState::Refused, FenceRefusal::Superseded, "attempt 3 is under way"};
const Leave kAwaited{LeaveState::Awaited, FenceRefusal::None, "the database does not answer"};

Result<PrintRecord> print_behind(Bench& b, LightFence& fence, const PrintPolicy& policy = {}) {
  PrintRunner runner{b.projector, b.stage, b.masks, b.journal, b.clock, &b.sensors, &fence};
  return runner.run(b.plan, policy, b.control, {}, b.stop.get_token());
}

TEST(PrintRunner, AsksItsFenceBeforeTheJournalAndBeforeTheLightOfEveryLayer) {
  Bench b{3};
  PlannedFence fence{[](int) { return Leave{}; }};
  const auto record = print_behind(b, fence);
  ASSERT_TRUE(record) << record.error().what;
  EXPECT_EQ(record->outcome, PrintOutcome::Done);
  EXPECT_EQ(record->attempt, 2U);
  EXPECT_EQ(fence.questions, 6);
  expect_every_layer_once(b);
}

TEST(PrintRunner, LightsNothingThatItsFenceRefusesAndLeavesNoLayerInQuestion) {
  for (int refused_at = 0; refused_at < 6; ++refused_at) {
    Bench b{3};
    PlannedFence fence{[&](int question) { return question == refused_at ? kNewer : Leave{}; }};
    const auto record = print_behind(b, fence);
    ASSERT_TRUE(record) << record.error().what;
    EXPECT_EQ(record->outcome, PrintOutcome::Faulted);
    EXPECT_EQ(record->withheld, FenceRefusal::Superseded);
    EXPECT_FALSE(record->maybe_exposed);
    EXPECT_EQ(b.log.light().size(), static_cast<std::size_t>(refused_at / 2));
    EXPECT_EQ(b.journal.resume_point(), (ResumePoint{LayerIndex{std::uint32_t(refused_at / 2)}, false}));
    EXPECT_EQ(b.journal.entries().back().step, JournalStep::Stopped) << "it goes on as behind an orderly stop";
    EXPECT_EQ(print_record_from_json(to_json(*record)).value(), *record);
    // With leave again it goes on with the exact next layer.
    ASSERT_TRUE(print_behind(b, fence));
    expect_every_layer_once(b);
  }
}

TEST(PrintRunner, AnnouncesNoLayerBeforeItsFenceGaveLeave) {
  Bench b{1};
  PlannedFence fence{[&](int) { return kNewer; }};
  ASSERT_TRUE(print_behind(b, fence));
  for (const JournalEntry& entry : b.journal.entries()) EXPECT_NE(entry.step, JournalStep::Exposing);
}

TEST(PrintRunner, WaitsDarkAndAtRestForTheLeaveAndGoesBackWhereNoneComes) {
  Bench b{1};
  PlannedFence late{[&](int question) { return question < 20 ? kAwaited : Leave{}; }};
  const auto printed = print_behind(b, late);
  ASSERT_TRUE(printed);
  EXPECT_EQ(printed->outcome, PrintOutcome::Done);
  expect_every_layer_once(b);
  Bench never{1};
  PlannedFence silent{[&](int) { return kAwaited; }};
  const Nanoseconds began = never.clock.now();
  const auto back = print_behind(never, silent);
  ASSERT_TRUE(back);
  EXPECT_EQ(back->withheld, FenceRefusal::Unanswered);
  EXPECT_GE(never.clock.now() - began, PrintPolicy{}.longest_leave);
  EXPECT_TRUE(never.log.light().empty());
}

TEST(PrintRunner, EndsTheWaitForLeaveWithTheSite) {
  Bench b{1};
  PlannedFence silent{[&](int question) {
    if (question == 3) b.stop.request_stop();
    return kAwaited;
  }};
  const auto record = print_behind(b, silent);
  ASSERT_TRUE(record);
  EXPECT_EQ(record->withheld, FenceRefusal::Unanswered);
  EXPECT_LE(silent.questions, 5);
  EXPECT_TRUE(b.log.light().empty());
}

TEST(PrintRunner, BeginsNothingOfAnOlderAttemptThanItsJournalIsOf) {
  Bench b{1};
  JournalEntry newer{JournalStep::Planned, {}, {}, plan_digest(b.plan), {}, {}, {}, 3};
  ASSERT_TRUE(b.journal.write(newer));
  PlannedFence fence{[](int) { return Leave{}; }};
  const auto refused = print_behind(b, fence);
  ASSERT_FALSE(refused);
  EXPECT_EQ(refused.error().code, ErrorCode::Conflict);
  EXPECT_TRUE(b.log.light().empty());
}

}  // namespace
}  // namespace telefab::fab
