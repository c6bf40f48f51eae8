// SPDX-License-Identifier: GPL-3.0-or-later
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <telefab/fab/device/virtual_projector.hpp>
#include <telefab/fab/drivers/make_devices.hpp>
#include <telefab/fab/drivers/marlin_model.hpp>
#include <telefab/fab/drivers/model_transport.hpp>
#include <telefab/test/print_rig.hpp>

namespace telefab::fab {
namespace {

using namespace std::chrono_literals;
using testing::HasSubstr;

struct MarlinBench {
  explicit MarlinBench(MarlinBoard board = {}, Thermometer thermometer = Thermometer::Bed)
      : model{25, clock, &log, board},
        options{.dialect = StageDialect::Marlin, .top_mm = 25, .homing_mm_per_s = 20, .thermometer = thermometer} {}
  void open() {
    auto made = SerialStage::open(std::make_unique<ModelLine>(model, clock), options, clock);
    ASSERT_TRUE(made) << made.error().what;
    stage = std::move(*made);
  }
  Result<StageStatus> rest(Nanoseconds most = 100s) {
    for (const Nanoseconds until = clock.now() + most; clock.now() < until; clock.sleep_for(10ms)) {
      auto status = stage->poll();
      if (!status || !status->moving) return status;
    }
    return fail(ErrorCode::Internal, "never at rest");
  }
  /// The reading after some time at rest, asking at every turn.
  Result<std::optional<double>> felt_after(Nanoseconds time) {
    for (const Nanoseconds until = clock.now() + time; clock.now() < until; clock.sleep_for(10ms))
      if (auto celsius = stage->celsius(); !celsius) return celsius;
    return stage->celsius();
  }
  VirtualClock clock;
  MachineLog log;
  MarlinModel model;
  SerialStageOptions options;
  std::unique_ptr<SerialStage> stage;
};

TEST(MarlinStage, HomesUpThenGoesWhereItIsSentAndTakesTheTimeOfTheMove) {
  MarlinBench b;
  b.open();
  ASSERT_TRUE(b.stage->home());
  EXPECT_NEAR(b.rest()->z_mm, 25, 1e-6);
  const Nanoseconds from = b.clock.now();
  ASSERT_TRUE(b.stage->move_to(10, 3));
  const auto status = b.rest();
  ASSERT_TRUE(status) << status.error().what;
  EXPECT_NEAR(status->z_mm, 10, 1e-2);
  EXPECT_NEAR(b.model.gap_mm(), 10, 1e-3);
  EXPECT_NEAR(double((b.clock.now() - from).count()) * 1e-9, 5, 0.06);
}

TEST(MarlinStage, WaitsThroughBusyLinesOfALongMove) {
  MarlinBench b;
  b.open();
  ASSERT_TRUE(b.stage->home());
  (void)b.rest();
  ASSERT_TRUE(b.stage->move_to(5, 1));  // twenty seconds
  EXPECT_NEAR(b.rest()->z_mm, 5, 1e-2);
}

TEST(MarlinStage, HoldsInTheMiddleOfAMoveAndCountsNoStaleAnswerAfterwards) {
  for (const Nanoseconds when : {0ns, Nanoseconds{50ms}, Nanoseconds{1s}, Nanoseconds{2500ms}}) {
    SCOPED_TRACE(when.count());
    MarlinBench b;
    b.open();
    ASSERT_TRUE(b.stage->home());
    (void)b.rest();
    ASSERT_TRUE(b.stage->move_to(5, 3));
    for (const Nanoseconds until = b.clock.now() + when; b.clock.now() < until; b.clock.sleep_for(10ms))
      ASSERT_TRUE(b.stage->poll());
    ASSERT_TRUE(b.stage->hold());
    const double held = b.model.gap_mm();
    b.clock.advance(20s);
    EXPECT_NEAR(b.model.gap_mm(), held, 1e-9);
    ASSERT_TRUE(b.stage->home());
    EXPECT_NEAR(b.rest()->z_mm, 25, 1e-6);
    EXPECT_NEAR(b.model.gap_mm(), 25, 1e-6) << "it called itself homed before it was";
    ASSERT_TRUE(b.stage->move_to(5, 3));
    EXPECT_NEAR(b.rest()->z_mm, 5, 1e-2);
  }
}

TEST(MarlinStage, SaysWhenALineIsLostAndWhenTheBoardHalts) {
  MarlinBench b;
  b.open();
  ASSERT_TRUE(b.stage->home());
  (void)b.rest();
  b.model.lose_next_line();
  ASSERT_TRUE(b.stage->move_to(5, 3));
  EXPECT_EQ(b.rest().error().code, ErrorCode::DeviceTimeout);
  ASSERT_TRUE(b.stage->home());
  (void)b.rest();
  ASSERT_TRUE(b.stage->move_to(5, 3));
  b.model.halt();
  const auto halted = b.rest();
  ASSERT_FALSE(halted);
  EXPECT_THAT(halted.error().what, HasSubstr("Thermal Runaway"));
  ASSERT_TRUE(b.stage->home()) << "opening the port again restarts it";
  EXPECT_TRUE(b.rest());
}

TEST(MarlinStage, FeelsTheResinAtRestAndInMotionWhetherTheBoardReportsByItselfOrNot) {
  for (const bool reports : {true, false}) {
    SCOPED_TRACE(reports);
    MarlinBench b{{.reports_temperatures = reports}};
    b.open();
    b.model.bed_celsius = 31.5;
    ASSERT_EQ(b.felt_after(4s).value_or(std::nullopt), 31.5);
    ASSERT_TRUE(b.stage->home());
    EXPECT_NEAR(b.rest()->z_mm, 25, 1e-6);
    b.model.bed_celsius = 40.25;
    ASSERT_EQ(b.felt_after(4s).value_or(std::nullopt), 40.25);
    for (int i = 0; i < 20; ++i) {  // questions asked at rest, answers that arrive in motion
      (void)b.felt_after(Milliseconds{i * 130 + 1900});
      ASSERT_TRUE(b.stage->move_to(i % 2 == 0 ? 5 : 20, 3));
      const auto status = b.rest();
      ASSERT_TRUE(status) << status.error().what;
      EXPECT_NEAR(b.model.gap_mm(), i % 2 == 0 ? 5 : 20, 1e-3) << "taken for at rest before it was";
    }
  }
}

TEST(MarlinStage, ReadsTheSensorThatHangsInTheResin) {
  for (const auto& [thermometer, celsius] : {std::pair{Thermometer::Hotend, 21.0}, std::pair{Thermometer::Bed, 25.0},
                                             std::pair{Thermometer::Chamber, 23.0}}) {
    MarlinBench b{{}, thermometer};
    b.open();
    EXPECT_EQ(b.felt_after(3s).value_or(std::nullopt), celsius) << name_of(thermometer);
  }
  MarlinBench none{{}, Thermometer::None};
  none.open();
  EXPECT_EQ(none.felt_after(10s).value_or(1.0), std::nullopt);
}

TEST(MarlinStage, FailsWhereTheThermometerSaysNothing) {
  MarlinBench b{{.reports_temperatures = false, .has_thermistors = false}};
  b.open();
  const auto felt = b.felt_after(20s);
  ASSERT_FALSE(felt);
  EXPECT_EQ(felt.error().code, ErrorCode::DeviceTimeout);
  EXPECT_THAT(felt.error().what, HasSubstr("thermometer"));
}

TEST(TemperatureReport, GivesTheNamedSensorAndNothingElse) {
  const char* report = "ok T:21.37 /0.00 B:60.1 /60.00 T0:21.37 /0.00 @:0 B@:127";
  EXPECT_EQ(celsius_in(report, Thermometer::Hotend), 21.37);
  EXPECT_EQ(celsius_in(report, Thermometer::Bed), 60.1);
  EXPECT_EQ(celsius_in(report, Thermometer::Chamber), std::nullopt);
  EXPECT_EQ(celsius_in(report, Thermometer::None), std::nullopt);
  EXPECT_EQ(celsius_in("T: 21.5 /0", Thermometer::Hotend), 21.5);
  EXPECT_EQ(celsius_in("T:-14.20 /0.00 B:nan /0", Thermometer::Hotend), -14.2);
  for (const char* none : {"", "ok", "T:", "T:x", "RESET:5", "X:0.00 Z:5.00 E:0 Count X:0", "B:nan", "B:inf"}) {
    EXPECT_EQ(celsius_in(none, Thermometer::Hotend), std::nullopt) << none;
    EXPECT_EQ(celsius_in(none, Thermometer::Bed), std::nullopt) << none;
  }
}

/// A job on a Marlin stage with a thermometer; the projector is virtual.
struct HeatedPrint {
  MarlinBench bench;
  test::FormulaMasks masks{{24, 16}};
  PrintPlan plan = test::formula_plan(masks, {24, 16}, 4, 700ms);
  VirtualProjector projector{{24, 16}, 0, bench.clock, bench.log};
  PrintJournal journal = *PrintJournal::open(memory_journal_file());
  PrintControl control;
  PrintPolicy policy;

  PrintRecord print(const PrintSink& sink = {}) {
    const auto sensors = thermometer_of(*bench.stage);
    PrintRunner runner{projector, *bench.stage, masks, journal, bench.clock, sensors.get()};
    const auto record = runner.run(plan, policy, control, sink, {});
    EXPECT_TRUE(record) << (record ? "" : record.error().what);
    return record ? *record : PrintRecord{};
  }
};

TEST(HeatedPrint, KeepsTheResinsTemperatureOfEveryLayer) {
  HeatedPrint p;
  p.bench.open();
  const PrintRecord record = p.print([&](const PrintProgress& now) {
    if (now.phase == PrintPhase::Lowering) p.bench.model.bed_celsius = 25.0 + now.layer.count();
  });
  ASSERT_EQ(record.outcome, PrintOutcome::Done) << record.cause.what;
  ASSERT_EQ(record.layers.size(), 4u);
  for (const LayerRecord& layer : record.layers) EXPECT_EQ(layer.resin_celsius, 25.0 + layer.index.count());
}

TEST(HeatedPrint, StopsDarkOutsideTheLimitsAndGoesOnWithinThem) {
  for (const double wrong : {45.5, 12.0}) {
    SCOPED_TRACE(wrong);
    HeatedPrint p;
    p.policy.hottest_celsius = 45;
    p.policy.coldest_celsius = 15;
    p.bench.open();
    PrintRecord record = p.print([&](const PrintProgress& now) {
      if (now.phase == PrintPhase::Lifting && now.layer == LayerIndex{2}) p.bench.model.bed_celsius = wrong;
    });
    EXPECT_EQ(record.outcome, PrintOutcome::Faulted);
    EXPECT_EQ(record.cause.code, ErrorCode::NotPermitted);
    EXPECT_THAT(record.cause.what, HasSubstr(wrong > 20 ? "45.5 degrees, too hot" : "12.0 degrees, too cold"));
    EXPECT_FALSE(record.maybe_exposed);
    EXPECT_EQ(p.bench.log.light().size(), 2u);
    EXPECT_EQ(p.print().outcome, PrintOutcome::Faulted) << "still outside";
    EXPECT_EQ(p.bench.log.light().size(), 2u);
    p.bench.model.bed_celsius = 25;
    p.bench.clock.advance(2s);
    record = p.print();
    for (int tries = 0; tries < 3 && record.outcome != PrintOutcome::Done; ++tries) record = p.print();
    EXPECT_EQ(record.outcome, PrintOutcome::Done) << record.cause.what;
    EXPECT_EQ(p.bench.log.light().size(), 4u);
    EXPECT_EQ(p.bench.log.light_while_moving(), 0ns);
  }
}

TEST(RealDevices, AreRefusedUntilTheProfileStatesWhatNobodyMayGuess) {
  const auto refusal = [](auto change) {
    MachineProfile machine;
    change(machine.devices);
    VirtualClock clock;
    const auto made = make_devices(machine, clock);
    return made ? std::string{} : made.error().what;
  };
  EXPECT_THAT(refusal([](auto& d) { d.projector = ProjectorKind::Dlpc900; }), HasSubstr("led_polarity"));
  EXPECT_THAT(refusal([](auto& d) {
                d.projector = ProjectorKind::Dlpc900;
                d.led_polarity = LedPolarity::Normal;
              }),
              HasSubstr("led_current is 0"));
  EXPECT_THAT(refusal([](auto& d) { d.thermometer = Thermometer::Bed; }), HasSubstr("thermometer"));
  EXPECT_THAT(refusal([](auto& d) { d.hottest_celsius = 40; }), HasSubstr("limits"));
  EXPECT_THAT(refusal([](auto& d) {
                d.stage = StageKind::Marlin;
                d.thermometer = Thermometer::Bed;
                d.hottest_celsius = 20;
                d.coldest_celsius = 30;
              }),
              HasSubstr("hottest"));
}

}  // namespace
}  // namespace telefab::fab
