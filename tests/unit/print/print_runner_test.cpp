// SPDX-License-Identifier: GPL-3.0-or-later
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <telefab/fab/device/virtual_projector.hpp>
#include <telefab/fab/device/virtual_z_stage.hpp>
#include <telefab/fab/print/print_runner.hpp>

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

struct Bench {
  explicit Bench(std::uint32_t layers = 6) {
    plan.job = "j1";
    plan.machine = "m";
    plan.mask_size = kSize;
    plan.motion = {5.0, 2.0, 3.0, 0.5};
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
  PrintPlan plan;
  StripedMasks masks;
  VirtualClock clock;
  MachineLog log;
  VirtualProjector projector{kSize, 0, clock, log};
  VirtualZStage stage{25, clock, log};
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

TEST(PrintRunner, TakesTheTimeItWasEstimatedToTake) {
  Bench b{40};
  b.print();
  const double estimate = double(print_time(b.plan, {}, 25, b.stage.facts().homing_mm_per_s, {}).count());
  EXPECT_NEAR(double(b.clock.now().count()) / estimate, 1, 0.02);
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
  for (const PrintPhase where :
       {PrintPhase::Homing, PrintPhase::Lowering, PrintPhase::Settling, PrintPhase::Exposing, PrintPhase::Lifting}) {
    SCOPED_TRACE(name_of(where));
    Bench b;
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
  for (const PrintPhase where :
       {PrintPhase::Homing, PrintPhase::Lowering, PrintPhase::Settling, PrintPhase::Exposing, PrintPhase::Lifting}) {
    SCOPED_TRACE(name_of(where));
    Bench b;
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

}  // namespace
}  // namespace telefab::fab
