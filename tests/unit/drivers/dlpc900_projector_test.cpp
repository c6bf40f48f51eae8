// SPDX-License-Identifier: GPL-3.0-or-later
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <telefab/fab/drivers/make_devices.hpp>
#include <telefab/fab/mask/orientation.hpp>
#include <telefab/fab/usb/decorators.hpp>
#include <telefab/test/print_rig.hpp>

namespace telefab::fab {
namespace {

using namespace std::chrono_literals;
using test::FormulaMasks;
using test::PrintRig;

/// A transport that somebody else owns.
class Borrowed final : public UsbTransport {
 public:
  explicit Borrowed(UsbTransport& inner) : inner_{inner} {}
  Result<void> write(std::uint8_t e, std::span<const std::byte> b, Milliseconds t) override {
    return inner_.write(e, b, t);
  }
  Result<std::vector<std::byte>> read(std::uint8_t e, std::size_t n, Milliseconds t) override {
    return inner_.read(e, n, t);
  }
  Result<void> clear_halt(std::uint8_t e) override { return inner_.clear_halt(e); }
  Result<void> reopen() override { return inner_.reopen(); }
  std::string describe() const override { return inner_.describe(); }

 private:
  UsbTransport& inner_;
};

struct OneLayer {
  Result<void> show(UsbTransport& bus, Microseconds exposure = 200ms) {
    auto projector = Dlpc900Projector::open(std::make_unique<Borrowed>(bus), options, clock);
    if (!projector) return tl::unexpected{projector.error()};
    const auto mask = masks.mask(LayerIndex{0});
    if (const auto ok = (*projector)->load(mask->view(), {exposure}); !ok) return ok;
    for (int i = 0; i < 20000; ++i) {
      const auto status = (*projector)->poll();
      if (!status) return tl::unexpected{status.error()};
      if (status->state == LightState::Loaded)
        if (const auto ok = (*projector)->expose(); !ok) return ok;
      if (status->state == LightState::Exposed) {
        parts = status->report.parts;
        return {};
      }
      clock.sleep_for(10ms);
    }
    return fail(ErrorCode::Internal, "never exposed");
  }
  Dlpc900Options options{.mask = PrintRig::kSize, .led_current = 10};
  std::uint32_t parts = 0;
  VirtualClock clock;
  MachineLog log;
  Dlpc900Model model{1, 6, clock, &log};
  ModelUsb usb{model, clock};
  FormulaMasks masks{PrintRig::kSize};
};

TEST(Dlpc900Projector, GivesEveryMirrorItsDoseAndNoneBeside) {
  OneLayer bench;
  ASSERT_TRUE(bench.show(bench.usb));
  const Mask want =
      place_on_mirrors(bench.masks.mask(LayerIndex{0})->view(), bench.model.mirrors(), OpticsTurn::Normal);
  const auto dose = bench.model.dose_s();
  ASSERT_EQ(dose.size(), want.rows.size());
  for (std::size_t i = 0; i < dose.size(); ++i) ASSERT_NEAR(dose[i], 0.2 * want.rows[i] / 255, 0.002) << "mirror " << i;
  EXPECT_EQ(bench.model.endless_orders(), 0u);
  EXPECT_EQ(bench.model.refusals(), 0u);
}

TEST(Dlpc900Projector, DrivesBothHalvesOfATwoControllerArray) {
  OneLayer bench;
  Dlpc900Model model{2, 6, bench.clock, &bench.log};
  ModelUsb usb{model, bench.clock};
  ASSERT_TRUE(bench.show(usb));
  EXPECT_EQ(model.image(),
            place_on_mirrors(bench.masks.mask(LayerIndex{0})->view(), model.mirrors(), OpticsTurn::Normal));
}

/// A part without any symmetry, an L that leans to one corner.
Mask leaning_l(PixelSize size) {
  Mask mask{size, std::vector<std::uint8_t>(std::size_t{size.width_px} * size.height_px)};
  for (std::uint32_t y = 0; y < size.height_px; ++y)
    for (std::uint32_t x = 0; x < size.width_px; ++x)
      if ((x < size.width_px / 5 && y > size.height_px / 6) ||
          (y > size.height_px * 3 / 4 && x < size.width_px * 2 / 3))
        mask.rows[std::size_t{y} * size.width_px + x] = static_cast<std::uint8_t>(50 + (x + 3 * y) % 200);
  return mask;
}

/// What lies on the vat of a machine whose optics and wiring are as its profile says: the light of the mirrors, each
/// controller's half on its side, seen through the optics.
TEST(Dlpc900Projector, LaysAnAsymmetricPartOnTheVatWhateverOpticsAndWiring) {
  for (const std::uint8_t type : {std::uint8_t{1}, std::uint8_t{2}})
    for (const auto optics : {OpticsTurn::Normal, OpticsTurn::MirrorX, OpticsTurn::MirrorY, OpticsTurn::Rotate180})
      for (const auto wiring : {MirrorControllers::Auto, MirrorControllers::LeftRight, MirrorControllers::RightLeft}) {
        if (type == 1 && wiring != MirrorControllers::Auto) continue;
        OneLayer bench;
        Dlpc900Model model{type, 6, bench.clock, &bench.log};
        ModelUsb usb{model, bench.clock};
        // As large as all mirrors, so that nothing is centred.
        bench.options.mask = model.mirrors();
        bench.options.orientation = optics;
        bench.options.controllers = wiring;
        const Mask part = leaning_l(model.mirrors());
        auto projector = Dlpc900Projector::open(std::make_unique<Borrowed>(usb), bench.options, bench.clock);
        ASSERT_TRUE(projector) << projector.error().what;
        ASSERT_TRUE((*projector)->load(part.view(), {200ms}));
        for (int i = 0; i < 20000 && (*projector)->poll()->state != LightState::Loaded; ++i)
          bench.clock.sleep_for(10ms);
        ASSERT_TRUE((*projector)->expose());
        // The model puts the first controller's half on the left; this machine may have it on the right.
        Mask mirrors = model.image();
        if (wiring == MirrorControllers::RightLeft) {
          const auto halves = halves_of(mirrors.view());
          const std::uint32_t half = mirrors.size.width_px / 2;
          for (std::uint32_t y = 0; y < mirrors.size.height_px; ++y)
            for (std::uint32_t x = 0; x < half; ++x) {
              const std::size_t row = std::size_t{y} * mirrors.size.width_px;
              mirrors.rows[row + half + x] = halves[0].rows[std::size_t{y} * half + x];
              mirrors.rows[row + x] = halves[1].rows[std::size_t{y} * half + x];
            }
        }
        EXPECT_TRUE(turned_for_optics(mirrors.view(), orientation_of(optics)) == part)
            << int{type} << ' ' << name_of(optics) << ' ' << name_of(wiring);
      }
}

TEST(Dlpc900Projector, RefusesAProfileThatStatesOtherControllersThanItHas) {
  OneLayer bench;
  bench.options.controllers = MirrorControllers::LeftRight;
  EXPECT_THAT(bench.show(bench.usb).error().what, testing::HasSubstr("projection.controllers"));
  Dlpc900Model model{2, 6, bench.clock, &bench.log};
  ModelUsb usb{model, bench.clock};
  bench.options.controllers = MirrorControllers::One;
  EXPECT_EQ(bench.show(usb).error().code, ErrorCode::InvalidInput);
}

TEST(Dlpc900Projector, WorksOnEveryFirmwareOfTheTable) {
  for (std::uint8_t major = 4; major <= 6; ++major) {
    OneLayer bench;
    Dlpc900Model model{1, major, bench.clock, &bench.log};
    ModelUsb usb{model, bench.clock};
    EXPECT_TRUE(bench.show(usb)) << int{major};
    EXPECT_EQ(model.refusals(), 0u);
  }
}

TEST(Dlpc900Projector, SplitsAnExposureTheControllerCannotCount) {
  OneLayer bench;
  ASSERT_TRUE(bench.show(bench.usb, 40s));
  EXPECT_EQ(bench.parts, 3u);
  Nanoseconds lit{};
  for (const LitSpan& span : bench.log.light()) lit += span.until - span.from;
  EXPECT_NEAR(double(lit.count()), 40e9, 1e5);
}

TEST(Dlpc900Projector, MeasuresTheUploadRate) {
  OneLayer bench;
  const auto projector = Dlpc900Projector::open(std::make_unique<ModelUsb>(bench.model, bench.clock),
                                                {.mask = PrintRig::kSize}, bench.clock);
  ASSERT_TRUE(projector);
  EXPECT_NEAR((*projector)->facts().upload_bytes_per_s, 64000, 1500);
}

TEST(Dlpc900Projector, EndsDarkWhereverTheBusBreaks) {
  std::size_t calls = 0;
  {
    OneLayer bench;
    FailingUsb counting{bench.usb, SIZE_MAX, 0, ErrorCode::DeviceLost};
    ASSERT_TRUE(bench.show(counting));
    calls = counting.calls();
  }
  ASSERT_GT(calls, 100u);
  int failures = 0;
  for (const ErrorCode code : {ErrorCode::DeviceLost, ErrorCode::DeviceTimeout, ErrorCode::DeviceRefused})
    for (std::size_t n = 0; n < calls; ++n) {
      OneLayer bench;
      bench.model.add_up_dose(false);
      FailingUsb usb{bench.usb, n, SIZE_MAX, code};
      failures += !bench.show(usb);  // the last calls only switch off what is off already
      bench.clock.advance(300ms);    // the controller's own timer
      bench.model.tick();
      EXPECT_FALSE(bench.model.lit()) << "bus lost at call " << n;
      for (const LitSpan& lit : bench.log.light()) EXPECT_LE(lit.until - lit.from, 200ms);
    }
  EXPECT_GT(failures, 300);
}

TEST(Dlpc900Projector, AnswersTheSameBytesAsItsTranscript) {
  OneLayer bench;
  RecordingUsb recording{bench.usb};
  ASSERT_TRUE(bench.show(recording));
  const auto transcript = transcript_from_text(to_text(recording.transcript()));
  ASSERT_TRUE(transcript);
  EXPECT_EQ(*transcript, recording.transcript());
  ReplayUsb replay{*transcript};
  OneLayer again;
  // Replayed bytes take no time, so the driver sees the exposure end at the first poll behind its length.
  class Timed final : public UsbTransport {
   public:
    Timed(UsbTransport& inner, Clock& clock) : inner_{inner}, clock_{clock} {}
    Result<void> write(std::uint8_t e, std::span<const std::byte> b, Milliseconds t) override {
      clock_.sleep_for(std::chrono::milliseconds{b.size() / 64});
      return inner_.write(e, b, t);
    }
    Result<std::vector<std::byte>> read(std::uint8_t e, std::size_t n, Milliseconds t) override {
      clock_.sleep_for(1ms);
      return inner_.read(e, n, t);
    }
    Result<void> clear_halt(std::uint8_t e) override { return inner_.clear_halt(e); }
    Result<void> reopen() override { return inner_.reopen(); }
    std::string describe() const override { return inner_.describe(); }

   private:
    UsbTransport& inner_;
    Clock& clock_;
  } timed{replay, again.clock};
  EXPECT_TRUE(again.show(timed));
  EXPECT_TRUE(replay.finished());
}

TEST(Dlpc900Projector, RefusesAMaskWiderThanItsMirrors) {
  OneLayer bench;
  const auto made =
      Dlpc900Projector::open(std::make_unique<ModelUsb>(bench.model, bench.clock), {.mask = {1921, 100}}, bench.clock);
  ASSERT_FALSE(made);
  EXPECT_THAT(made.error().what, testing::HasSubstr("1920 x 1080"));
}

TEST(PlaceOnMirrors, TurnsTheMaskAsTheOpticsDemand) {
  const Mask m{{2, 2}, {1, 2, 3, 4}};
  EXPECT_EQ(place_on_mirrors(m.view(), {2, 2}, OpticsTurn::Normal).rows, (std::vector<std::uint8_t>{1, 2, 3, 4}));
  EXPECT_EQ(place_on_mirrors(m.view(), {2, 2}, OpticsTurn::MirrorX).rows, (std::vector<std::uint8_t>{2, 1, 4, 3}));
  EXPECT_EQ(place_on_mirrors(m.view(), {2, 2}, OpticsTurn::MirrorY).rows, (std::vector<std::uint8_t>{3, 4, 1, 2}));
  EXPECT_EQ(place_on_mirrors(m.view(), {2, 2}, OpticsTurn::Rotate180).rows, (std::vector<std::uint8_t>{4, 3, 2, 1}));
}

/// Calls the projector as a print does and looks at the board's LEDs after every call.
struct LedBench {
  explicit LedBench(LedBoard board) : model{1, 6, bench.clock, &bench.log, board}, usb{model, bench.clock} {}
  /// The LEDs' glow during the light; whatever else they did goes into `stray`.
  Result<void> show_and_watch() {
    auto projector = Dlpc900Projector::open(std::make_unique<Borrowed>(usb), bench.options, bench.clock);
    if (!projector) return tl::unexpected{projector.error()};
    const auto must_be_dark = [&] { stray = std::max<unsigned>(stray, model.glow()); };
    must_be_dark();
    const Mask mask = *bench.masks.mask(LayerIndex{0});
    for (int layer = 0; layer < 2; ++layer) {
      if (const auto ok = (*projector)->load(mask.view(), {200ms}); !ok) return ok;
      while (true) {
        const auto status = (*projector)->poll();
        if (!status) return tl::unexpected{status.error()};
        if (status->state == LightState::Loaded) {
          must_be_dark();
          if (const auto ok = (*projector)->expose(); !ok) return ok;
          in_light = model.glow();
        }
        if (status->state == LightState::Exposed) break;
        bench.clock.sleep_for(10ms);
      }
      must_be_dark();
    }
    if (const auto ok = (*projector)->load(mask.view(), {900ms}); !ok) return ok;
    while ((*projector)->poll()->state != LightState::Loaded) bench.clock.sleep_for(10ms);
    if (const auto ok = (*projector)->expose(); !ok) return ok;
    bench.clock.sleep_for(100ms);
    if (const auto ok = (*projector)->dark(); !ok) return ok;
    must_be_dark();
    return {};
  }
  OneLayer bench;
  Dlpc900Model model;
  ModelUsb usb;
  unsigned stray = 0, in_light = 0;
};

TEST(LedBoards, GiveTheirStatedCurrentInTheLightAndNothingElsewhereOnceTheirProfileIsRight) {
  for (const bool inverted : {false, true})
    for (const bool enable_reaches : {false, true}) {
      SCOPED_TRACE(inverted * 2 + enable_reaches);
      LedBench b{{.inverted_pwm = inverted, .enable_reaches_leds = enable_reaches}};
      b.bench.options.inverted_led_polarity = inverted;
      b.bench.options.off_needs_zero_current = !enable_reaches;
      const auto shown = b.show_and_watch();
      ASSERT_TRUE(shown) << shown.error().what;
      EXPECT_EQ(b.in_light, 10u);
      EXPECT_EQ(b.stray, 0u);
    }
}

// The controller ends an exposure by itself; the current of such a board ends only if this computer says so.
TEST(LedBoards, ThatNothingDarkensWhereThisComputerDiesAreRefused) {
  VirtualClock clock;
  MachineProfile machine;
  machine.name = "m";
  machine.devices.projector = ProjectorKind::Dlpc900;
  machine.devices.led_polarity = LedPolarity::Normal;
  machine.devices.led_current = 10;
  machine.devices.projector_serial = "none has this one";
  machine.devices.led_off = LedOff::EnableAndCurrent;
  const auto refused = make_devices(machine, clock);
  ASSERT_FALSE(refused);
  EXPECT_EQ(refused.error().code, ErrorCode::InvalidInput);
  EXPECT_THAT(refused.error().what, testing::HasSubstr("devices.led_cutoff"));
  machine.devices.led_cutoff = LedCutoff::Watchdog;
  const auto looked_for = make_devices(machine, clock);
  ASSERT_FALSE(looked_for);
  EXPECT_NE(looked_for.error().code, ErrorCode::InvalidInput) << looked_for.error().what;
}

TEST(LedBoards, ThatCannotMakeAShareOfTheLightAreRefusedByName) {
  VirtualClock clock;
  MachineProfile machine;
  machine.name = "m";
  machine.devices.projector = ProjectorKind::Dlpc900;
  machine.devices.led_polarity = LedPolarity::Normal;
  machine.devices.led_current = 10;
  machine.devices.projector_serial = "none has this one";
  machine.layers.light_share = 0.33;
  const auto refused = make_devices(machine, clock);
  ASSERT_FALSE(refused);
  EXPECT_EQ(refused.error().code, ErrorCode::InvalidInput);
  EXPECT_THAT(refused.error().what, testing::HasSubstr("state layers.light_share = 0.3000"));
  machine.layers.light_share = 0.3;
  EXPECT_NE(make_devices(machine, clock).error().code, ErrorCode::InvalidInput);
}

TEST(LedBoards, OfAnyKindAreLitAtTheShareOfTheLoadedMaskAndAtFullAgainAfterIt) {
  for (const bool reaches : {true, false}) {
    VirtualClock clock;
    MachineLog log;
    Dlpc900Model model{1, 6, clock, &log, {.enable_reaches_leds = reaches}};
    auto projector = Dlpc900Projector::open(
        std::make_unique<ModelUsb>(model, clock),
        {.mask = test::PrintRig::kSize, .led_current = 100, .off_needs_zero_current = !reaches}, clock);
    ASSERT_TRUE(projector) << projector.error().what;
    test::FormulaMasks masks{test::PrintRig::kSize};
    for (const double share : {1.0, 0.2, 0.2, 0.57, 1.0}) {
      ASSERT_TRUE((*projector)->load(masks.mask(LayerIndex{0})->view(), {200ms, share}));
      LightState state = LightState::Loading;
      while (state == LightState::Loading) {
        const auto status = (*projector)->poll();
        ASSERT_TRUE(status) << status.error().what;
        state = status->state;
      }
      ASSERT_TRUE((*projector)->expose());
      while (state != LightState::Exposed) {
        clock.sleep_for(5ms);
        const auto status = (*projector)->poll();
        ASSERT_TRUE(status) << status.error().what;
        state = status->state;
      }
    }
    std::vector<double> currents;
    for (const LitSpan& lit : log.light()) currents.push_back(std::round(lit.share * 255));
    EXPECT_EQ(currents, (std::vector<double>{100, 20, 20, 57, 100}));
    EXPECT_EQ((*projector)->load(masks.mask(LayerIndex{0})->view(), {200ms, 0.003}).error().code,
              ErrorCode::InvalidInput);
  }
}

TEST(LedBoards, BetrayAWrongProfile) {
  LedBench wrong_polarity{{.inverted_pwm = true}};
  ASSERT_TRUE(wrong_polarity.show_and_watch());
  EXPECT_EQ(wrong_polarity.in_light, 255u) << "the lowest current is the brightest light";
  EXPECT_EQ(wrong_polarity.stray, 0u) << "the enable lines still darken it";
  LedBench wrong_off{{.enable_reaches_leds = false}};
  ASSERT_TRUE(wrong_off.show_and_watch());
  EXPECT_EQ(wrong_off.stray, 10u) << "only a current of zero would darken it";
}

/// A layer on a board that only a current of zero darkens, with a fault at a transfer of it; then dark, as a print asks
/// for it after whatever was refused. Whether it was lit at any rest that the projector called one.
struct FaultyLayer {
  FaultyLayer(ProjectorFault fault, std::uint64_t at) : bench{{.enable_reaches_leds = false}} {
    bench.bench.options.off_needs_zero_current = true;
    auto made = Dlpc900Projector::open(std::make_unique<Borrowed>(bench.usb), bench.bench.options, bench.bench.clock);
    if (!made) return;
    Dlpc900Projector& projector = **made;
    const std::uint64_t before = bench.model.transfers();
    bench.model.plan_fault(fault, at);
    layer(projector, fault == ProjectorFault::Reset);
    transfers = bench.model.transfers() - before;
    for (int tries = 0; tries < 3 && !is_dark; ++tries) is_dark = projector.dark().has_value();
    glow_when_dark = bench.model.glow();
    if (is_dark) return;
    // What cannot be reached darkens itself by its cutoff, and is dark once it is opened again.
    bench.model.power_cycle();
    bench.model.reopened();
    is_dark = projector.dark().has_value();
    glow_when_dark = bench.model.glow();
  }
  void layer(Dlpc900Projector& projector, bool restarts_by_itself) {
    const Mask mask = *bench.bench.masks.mask(LayerIndex{0});
    if (!projector.load(mask.view(), {100ms})) return;
    for (int i = 0; i < 1000; ++i) {
      const auto status = projector.poll();
      if (!status) return;
      if (status->state != LightState::Exposing && !restarts_by_itself)
        glow_at_rest = std::max<unsigned>(glow_at_rest, bench.model.glow());
      if (status->state == LightState::Loaded && !projector.expose()) return;
      if (status->state == LightState::Exposed) return;
      bench.bench.clock.sleep_for(10ms);
    }
  }
  LedBench bench;
  std::uint64_t transfers = 0;
  bool is_dark = false;
  unsigned glow_at_rest = 0, glow_when_dark = 0;
};

TEST(LedBoards, ThatACurrentLightsAreDarkAfterEveryFaultOfALayer) {
  std::size_t trials = 0;
  for (std::size_t f = 0; f < kProjectorFaults; ++f) {
    const auto fault = static_cast<ProjectorFault>(f);
    const std::uint64_t in_all = FaultyLayer{fault, 1'000'000}.transfers;
    ASSERT_GT(in_all, 30u);
    // Every third, and each of them by some fault.
    for (std::uint64_t at = f % 3; at < in_all; at += 3, ++trials) {
      const FaultyLayer each{fault, at};
      SCOPED_TRACE(::testing::Message() << name_of(fault) << " at transfer " << at << " of " << in_all);
      EXPECT_TRUE(each.is_dark);
      EXPECT_EQ(each.glow_when_dark, 0u) << "dark() was answered, and it glows";
      EXPECT_EQ(each.glow_at_rest, 0u);
      if (HasFailure()) return;
    }
  }
  EXPECT_GT(trials, 150u);
}

TEST(LedBoards, ThatKeepAnotherCurrentThanTheyWereToldAreRefused) {
  LedBench b{{.forgets_current = true}};
  const auto shown = b.show_and_watch();
  ASSERT_FALSE(shown);
  EXPECT_EQ(shown.error().code, ErrorCode::DeviceRefused);
  EXPECT_EQ(b.stray, 0u);
}

}  // namespace
}  // namespace telefab::fab
