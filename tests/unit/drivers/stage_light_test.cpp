// SPDX-License-Identifier: GPL-3.0-or-later
#include <fmt/format.h>
#include <gmock/gmock.h>

#include <telefab/fab/drivers/grbl_model.hpp>
#include <telefab/fab/drivers/make_devices.hpp>
#include <telefab/fab/drivers/marlin_model.hpp>
#include <telefab/fab/drivers/model_transport.hpp>
#include <telefab/test/stage_lit_rig.hpp>

namespace telefab::fab {
namespace {

using namespace std::chrono_literals;
using testing::HasSubstr;
using testing::Not;

LightGroup group(StageDialect dialect, const BoardLight& light, Microseconds duration, double full, double share = 1) {
  auto made = light_group(dialect, light, full, {duration, share});
  EXPECT_TRUE(made) << made.error().what;
  return made ? *made : LightGroup{};
}

TEST(LightGroup, IsOnePacketThatBeginsWithADwellAndEndsDark) {
  EXPECT_EQ(group(StageDialect::Grbl, {}, 2500ms, 1000).text, "G4P.19\nG1F1M3S1000G4P2.49\nM5\nM5\n");
  EXPECT_EQ(group(StageDialect::Marlin, {LightCommand::Fan}, 2500ms, 255).text, "G4P300\nM106\nG4P2500\nM107\nM107\n");
  EXPECT_EQ(
      group(StageDialect::Marlin, {.command = LightCommand::Pin, .number = 44, .packet_bytes = 64}, 36s, 255).text,
      "G4P300\nM42P44S255\nG4P36000\nM42P44S0\nM42P44S0\n");
  EXPECT_EQ(group(StageDialect::Marlin, {.command = LightCommand::Fan, .number = 1, .packet_bytes = 64}, 1s, 255).text,
            "G4P300\nM106P1\nG4P1000\nM107P1\nM107P1\n");
  for (const Microseconds duration :
       {Microseconds{50ms}, Microseconds{2500ms}, Microseconds{36s}, Microseconds{600s}}) {
    EXPECT_LE(group(StageDialect::Grbl, {}, duration, 9999).text.size(), 32u);
    EXPECT_LE(group(StageDialect::Marlin, {LightCommand::Fan}, duration, 255).text.size(), 32u);
  }
}

TEST(LightGroup, HasOneDarkLineWhereASecondDoesNotFit) {
  const LightGroup g = group(StageDialect::Grbl, {}, 112'450ms, 1000);
  EXPECT_EQ(g.text, "G4P.19\nG1F1M3S1000G4P112.44\nM5\n");
  EXPECT_EQ(g.lines, 3);
}

TEST(LightGroup, IsRefusedWhereItsAdapterDoesNotCarryItWhole) {
  const auto refused =
      light_group(StageDialect::Marlin, {.command = LightCommand::Pin, .number = 44}, 255, {Microseconds{2500ms}, 1});
  ASSERT_FALSE(refused);
  EXPECT_EQ(refused.error().code, ErrorCode::InvalidInput);
  EXPECT_THAT(refused.error().what, HasSubstr("light.packet_bytes = 64"));
}

TEST(LightGroup, HasNoMorePowerThanStatedAndIsDimmedInItsSteps) {
  EXPECT_THAT(group(StageDialect::Grbl, {.power = 0.8}, 1s, 1000).text, HasSubstr("S800G"));
  EXPECT_THAT(group(StageDialect::Grbl, {.power = 0.8, .steps = 10}, 1s, 1000, 0.5).text, HasSubstr("S400G"));
  EXPECT_THAT(group(StageDialect::Marlin, {.command = LightCommand::Fan, .power = 0.5}, 1s, 255).text,
              HasSubstr("M106S127\n"));
  EXPECT_FALSE(light_group(StageDialect::Grbl, {.power = 0.8, .steps = 10}, 1000, {Microseconds{1s}, 0.55}));
  EXPECT_FALSE(light_group(StageDialect::Grbl, {}, 1000, {Microseconds{1s}, 0.5})) << "it cannot be dimmed";
}

TEST(LightGroup, MakesMultiplesOfTheBoardsStepAndNothingElse) {
  EXPECT_TRUE(light_group(StageDialect::Grbl, {}, 1000, {Microseconds{2550ms}, 1}));
  EXPECT_THAT(light_group(StageDialect::Grbl, {}, 1000, {Microseconds{2510ms}, 1}).error().what, HasSubstr("50 ms"));
  EXPECT_TRUE(light_group(StageDialect::Marlin, {LightCommand::Fan}, 255, {Microseconds{2510ms}, 1}));
  EXPECT_FALSE(light_group(StageDialect::Marlin, {LightCommand::Fan}, 255, {Microseconds{2510500us}, 1}));
  EXPECT_FALSE(light_group(StageDialect::Grbl, {}, 1000, {Microseconds{0}, 1}));
  EXPECT_FALSE(light_group(StageDialect::Grbl, {}, 1000, {Microseconds{700s}, 1}));
}

/// A board, spoken to as its bytes.
struct RawGrbl {
  explicit RawGrbl(GrblBoard board = {}) : model{25, clock, &log, board} {
    clock.advance(1s);
    send("$H\n");
    clock.advance(5s);
    (void)model.transmit();
  }
  void send(std::string_view text) { EXPECT_TRUE(model.receive(text)); }
  std::string after(Nanoseconds time) {
    clock.advance(time);
    return model.transmit();
  }
  VirtualClock clock;
  MachineLog log;
  GrblModel model;
};

TEST(GrblModel, TimesTheLightItselfToAStepWhoeverLooks) {
  for (int steps = 1; steps < 1300; steps += 7) {
    RawGrbl b;
    b.send(group(StageDialect::Grbl, {}, steps * 50ms, 1000).text);
    b.clock.advance(100s);
    b.model.tick();
    EXPECT_EQ(b.model.lamp().lit_for(b.clock.now()), steps * 50ms) << steps;
    EXPECT_EQ(b.log.light().size(), 1u);
  }
}

TEST(GrblModel, DwellsAStepMoreForAHairAboveIt) {
  RawGrbl b;
  b.send("G1F1M3S1000G4P2.51\nM5\n");
  b.clock.advance(10s);
  b.model.tick();
  EXPECT_EQ(b.model.lamp().lit_for(b.clock.now()), 2550ms);
}

TEST(GrblModel, IsDarkAtOnceByAResetInAnyPartOfTheGroup) {
  for (const Nanoseconds when : {0ms, 100ms, 199ms, 200ms, 201ms, 1000ms, 2699ms}) {
    RawGrbl b;
    b.send("G4P.19\nG1F1M3S1000G4P2.49\nM5\n");
    b.clock.advance(when);
    b.send("\x18");
    EXPECT_FALSE(b.model.lamp().lit());
    b.clock.advance(10s);
    b.model.tick();
    EXPECT_EQ(b.model.lamp().lit_for(b.clock.now()), std::max(0ns, when - 200ms));
  }
}

TEST(GrblModel, HeldInADwellFreezesItDarkInLaserModeAndLitWithout) {
  for (const bool laser : {true, false}) {
    RawGrbl b{{.laser_mode = laser}};
    b.send("G4P.19\nG1F1M3S1000G4P0.99\nM5\n");
    b.clock.advance(700ms);
    b.send("!");
    EXPECT_EQ(b.model.lamp().lit(), !laser);
    b.clock.advance(60s);
    b.model.tick();
    EXPECT_EQ(b.model.lamp().lit(), !laser) << "nothing ends it";
    b.send("~");
    b.clock.advance(5s);
    b.model.tick();
    EXPECT_FALSE(b.model.lamp().lit());
    EXPECT_EQ(b.model.lamp().lit_for(b.clock.now()), laser ? 1000ms : 61000ms);
  }
}

TEST(GrblModel, RefusesWhatTheFirmwareRefuses) {
  RawGrbl b;
  const auto answer = [&](std::string_view line) {
    b.send(std::string{line} + "\n");
    return b.after(1s);
  };
  EXPECT_THAT(answer("G1M3S1000"), HasSubstr("error:22")) << "no speed yet";
  EXPECT_THAT(answer("G4"), HasSubstr("error:28"));
  EXPECT_THAT(answer("M3M5"), HasSubstr("error:21"));
  EXPECT_THAT(answer("M106"), HasSubstr("error:20"));
  EXPECT_THAT(answer("g4 p1 x"), HasSubstr("error:"));
  EXPECT_THAT(answer("M3S1000"), HasSubstr("ok"));
  EXPECT_FALSE(b.model.lamp().lit()) << "in laser mode nothing shines outside G1";
}

TEST(GrblModel, LosesWhatItsReceiveBufferDoesNotHold) {
  RawGrbl b;
  b.send("G4P1\n" + std::string(200, 'G'));
  EXPECT_GT(b.model.overflows(), 70u);
}

TEST(StageLight, IsRefusedOnAGrblBoardThatMustNotSwitchIt) {
  const auto refused = [](GrblBoard board) {
    VirtualClock clock;
    GrblModel model{25, clock, nullptr, board};
    auto stage =
        SerialStage::open(std::make_unique<ModelLine>(model, clock), {.top_mm = 25, .light = BoardLight{}}, clock);
    EXPECT_FALSE(stage);
    if (stage) return std::string{};
    EXPECT_EQ(stage.error().code, ErrorCode::DeviceRefused);
    return stage.error().what;
  };
  EXPECT_THAT(refused({.laser_mode = false}), HasSubstr("$32=1"));
  EXPECT_THAT(refused({.status_mask = 1}), HasSubstr("$10=3"));
  EXPECT_THAT(refused({.variable_spindle = false}), HasSubstr("variable spindle"));
  EXPECT_THAT(refused({.version = "0.9j"}), HasSubstr("GRBL 1.1"));
  EXPECT_THAT(refused({.full_s = 12000}), HasSubstr("$30"));
  EXPECT_THAT(refused({.least_s = 10}), HasSubstr("$31=0"));
  EXPECT_THAT(refused({.buffer_bytes = 24}), HasSubstr("at once"));
}

TEST(StageLight, IsOrderedFromAGrblBoardWithABufferOfAnySize) {
  for (const std::size_t bytes : {64u, 128u, 254u, 1024u}) {
    VirtualClock clock;
    GrblModel model{25, clock, nullptr, {.buffer_bytes = bytes}};
    auto stage = SerialStage::open(std::make_unique<ModelLine>(model, clock),
                                   {.top_mm = 25, .homing_mm_per_s = 20, .light = BoardLight{}}, clock);
    ASSERT_TRUE(stage) << stage.error().what;
    ASSERT_TRUE((*stage)->home());
    while ((*stage)->poll()->moving) clock.sleep_for(10ms);
    ASSERT_TRUE((*stage)->light({Microseconds{500ms}, 1}));
    while (!(*stage)->poll_light()->is_over) clock.sleep_for(10ms);
    EXPECT_EQ(model.lamp().lit_for(clock.now()), 500ms);
  }
}

TEST(StageLight, IsRefusedOnAMarlinBoardThatMustNotSwitchIt) {
  const auto refused = [](MarlinBoard board, BoardLight light) {
    VirtualClock clock;
    MarlinModel model{25, clock, nullptr, board};
    auto stage = SerialStage::open(std::make_unique<ModelLine>(model, clock),
                                   {.dialect = StageDialect::Marlin, .top_mm = 25, .light = light}, clock);
    return stage ? std::string{} : stage.error().what;
  };
  const BoardLight fan{.command = LightCommand::Fan}, pin{.command = LightCommand::Pin, .number = 9};
  EXPECT_EQ(refused({}, fan), "");
  EXPECT_EQ(refused({}, pin), "");
  EXPECT_EQ(refused({.queues_fans = true, .z_sync = true}, fan), "");
  EXPECT_THAT(refused({.has_emergency_parser = false}, fan), HasSubstr("EMERGENCY_PARSER"));
  EXPECT_THAT(refused({.fans = 0}, fan), HasSubstr("without a fan"));
  EXPECT_THAT(refused({.switches_pins = false}, pin), HasSubstr("DIRECT_PIN_CONTROL"));
  EXPECT_THAT(refused({}, BoardLight{.command = LightCommand::Pin, .number = 40}), HasSubstr("pin 40"));
  EXPECT_THAT(refused({.is_marlin = false}, fan), HasSubstr("not Marlin"));
  EXPECT_THAT(refused({}, BoardLight{}), HasSubstr("light.command"));
}

TEST(StageLight, IsRefusedOnABoardThatDoesNotRestartWhenItsPortIsOpened) {
  VirtualClock clock;
  MarlinModel model{25, clock, nullptr, {.restarts_on_open = false}};
  clock.advance(2s);
  (void)model.transmit();
  const auto stage = SerialStage::open(
      std::make_unique<ModelLine>(model, clock),
      {.dialect = StageDialect::Marlin, .top_mm = 25, .light = BoardLight{.command = LightCommand::Fan}}, clock);
  ASSERT_FALSE(stage);
  EXPECT_THAT(stage.error().what, HasSubstr("does not restart"));
}

TEST(StageLight, IsTimedAlikeByEveryBuildOfMarlin) {
  for (const bool queues : {false, true})
    for (const bool sync : {false, true}) {
      VirtualClock clock;
      MachineLog log;
      MarlinModel model{25, clock, &log, {.queues_fans = queues, .z_sync = sync}};
      auto stage = SerialStage::open(std::make_unique<ModelLine>(model, clock),
                                     {.dialect = StageDialect::Marlin,
                                      .top_mm = 25,
                                      .homing_mm_per_s = 20,
                                      .light = BoardLight{.command = LightCommand::Fan}},
                                     clock);
      ASSERT_TRUE(stage) << stage.error().what;
      ASSERT_TRUE((*stage)->home());
      while ((*stage)->poll()->moving) clock.sleep_for(10ms);
      ASSERT_TRUE((*stage)->light({Microseconds{1234ms}, 1}));
      while (!(*stage)->poll_light()->is_over) clock.sleep_for(10ms);
      EXPECT_EQ(model.lamp().lit_for(clock.now()), 1234ms);
    }
}

TEST(StageLight, WaitsForAStageThatIsHomedAndAtRest) {
  test::StageLitRig rig{test::ShownBy::Screen, test::LitBy::GrblSpindle, 1};
  ASSERT_TRUE(rig.connect());
  EXPECT_EQ(rig.stage->light({Microseconds{1s}, 1}).error().code, ErrorCode::Conflict);
  ASSERT_TRUE(rig.stage->home());
  EXPECT_EQ(rig.stage->light({Microseconds{1s}, 1}).error().code, ErrorCode::Conflict);
  EXPECT_EQ(rig.lamp().lit_for(rig.clock.now()), 0ns);
}

TEST(StageLight, IsReportedWhereSomebodyHoldsTheBoardInIt) {
  test::StageLitRig rig{test::ShownBy::Screen, test::LitBy::GrblSpindle, 1};
  ASSERT_TRUE(rig.connect());
  ASSERT_TRUE(rig.stage->home());
  while (rig.stage->poll()->moving) rig.clock.sleep_for(10ms);
  ASSERT_TRUE(rig.stage->light({Microseconds{1s}, 1}));
  rig.clock.advance(500ms);
  ASSERT_TRUE(rig.grbl.receive("!"));
  Result<StageLightStatus> status = StageLightStatus{};
  for (int i = 0; i < 300 && status && !status->is_over; ++i) {
    rig.clock.advance(10ms);
    status = rig.stage->poll_light();
  }
  ASSERT_FALSE(status);
  EXPECT_FALSE(rig.lamp().lit());
  ASSERT_TRUE(rig.stage->unlight());
  rig.clock.advance(10s);
  rig.tick();
  EXPECT_EQ(rig.lamp().lit_for(rig.clock.now()), 300ms);
}

/// A machine whose stage's board lights what its screen shows; nothing keeps it from printing.
MachineProfile lit_screen() {
  MachineProfile machine;
  machine.name = "m";
  machine.platform = {.width_mm = 64, .depth_mm = 40, .z_travel_mm = 100};
  machine.projection.pixel_pitch_mm = 1;
  machine.layers.exposure_s = 2;
  machine.layers.bottom_exposure_s = 16;
  machine.devices.projector = ProjectorKind::Screen;
  machine.devices.stage = StageKind::Grbl;
  machine.devices.light = LightSwitch::Stage;
  machine.screen.connector = "HDMI-A-1";
  machine.screen.width_px = 64;
  machine.screen.height_px = 40;
  return machine;
}

TEST(StageLight, OfAProfileIsRefusedUntilItCanBeAsPlanned) {
  const auto refusal = [](auto change) {
    MachineProfile machine = lit_screen();
    change(machine);
    const auto checked = check_devices(machine);
    return checked ? std::string{} : checked.error().what;
  };
  using M = MachineProfile;
  EXPECT_EQ(refusal([](M&) {}), "");
  EXPECT_THAT(refusal([](M& m) { m.devices.stage = StageKind::Virtual; }), HasSubstr("devices.stage"));
  EXPECT_THAT(refusal([](M& m) { m.devices.projector = ProjectorKind::Virtual; }), HasSubstr("devices.projector"));
  EXPECT_THAT(refusal([](M& m) { m.devices.stage = StageKind::Marlin; }), HasSubstr("light.command"));
  EXPECT_THAT(refusal([](M& m) { m.light.command = LightCommand::Fan; }), HasSubstr("light.command"));
  EXPECT_THAT(refusal([](M& m) { m.layers.exposure_s = 2.51; }), HasSubstr("multiples of 50 ms"));
  EXPECT_THAT(refusal([](M& m) { m.layers.bottom_exposure_s = 16.02; }), HasSubstr("multiples of 50 ms"));
  EXPECT_THAT(refusal([](M& m) { m.layers.light_share = 0.5; }), HasSubstr("light_share"));
  EXPECT_EQ(refusal([](M& m) { m.layers.light_share = 0.5, m.light.steps = 10; }), "");
  EXPECT_THAT(refusal([](M& m) {
                m.devices.projector = ProjectorKind::Dlpc900;
                m.devices.led_polarity = LedPolarity::Normal;
                m.devices.led_current = 10;
              }),
              HasSubstr("led_current = 0"));
  EXPECT_EQ(refusal([](M& m) {
              m.devices.projector = ProjectorKind::Dlpc900;
              m.devices.led_polarity = LedPolarity::Normal;
            }),
            "");
}

TEST(ScreenOfAProfile, IsRefusedUntilItsModeFitsAndSomethingDarkensALampThatIsAlwaysOn) {
  const auto refusal = [](auto change) {
    MachineProfile machine = lit_screen();
    change(machine);
    const auto checked = check_devices(machine);
    return checked ? std::string{} : checked.error().what;
  };
  using M = MachineProfile;
  EXPECT_THAT(refusal([](M& m) { m.screen.connector.clear(); }), HasSubstr("screen.connector"));
  EXPECT_THAT(refusal([](M& m) { m.screen.width_px = 63; }), HasSubstr("64 x 40"));
  EXPECT_THAT(refusal([](M& m) { m.screen.packing = PixelPacking::Bgr; }), HasSubstr("whole words"));
  EXPECT_THAT(refusal([](M& m) { m.devices.light = LightSwitch::Projector; }), HasSubstr("watchdog"));
  EXPECT_EQ(refusal([](M& m) {
              m.devices.light = LightSwitch::Projector;
              m.devices.led_cutoff = LedCutoff::Watchdog;
            }),
            "");
  EXPECT_THAT(refusal([](M& m) {
                m.devices.light = LightSwitch::Projector;
                m.devices.led_cutoff = LedCutoff::Watchdog;
                m.layers.light_share = 0.5;
              }),
              HasSubstr("light_share"));
}

TEST(StageLitProjector, RefusesAnExposureThatTheMirrorsDoNotStandFor) {
  test::StageLitRig rig{test::ShownBy::Dlpc900, test::LitBy::GrblSpindle, 1};
  ASSERT_TRUE(rig.connect());
  const auto mask = *rig.masks.mask(LayerIndex{0});
  EXPECT_TRUE(rig.projector->load(mask.view(), {Microseconds{15s}, 1}));
  const auto refused = rig.projector->load(mask.view(), {Microseconds{16s}, 1});
  ASSERT_FALSE(refused);
  EXPECT_EQ(refused.error().code, ErrorCode::InvalidInput);
}

TEST(StageLitProjector, PrintsNoPlanWhoseExposuresItsBoardCannotTime) {
  test::StageLitRig rig{test::ShownBy::Screen, test::LitBy::GrblSpindle, 2, Microseconds{710ms}};
  ASSERT_TRUE(rig.connect());
  const auto refused = rig.print();
  ASSERT_FALSE(refused);
  EXPECT_EQ(refused.error().code, ErrorCode::InvalidInput);
  EXPECT_THAT(refused.error().what, HasSubstr("steps of 50000 us"));
  EXPECT_EQ(rig.lamp().lit_for(rig.clock.now()), 0ns);
}

}  // namespace
}  // namespace telefab::fab
