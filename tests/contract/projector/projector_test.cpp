// SPDX-License-Identifier: GPL-3.0-or-later
#include <gtest/gtest.h>

#include <telefab/fab/device/virtual_projector.hpp>
#include <telefab/test/print_rig.hpp>
#include <telefab/test/stage_lit_rig.hpp>

// One suite, every light engine: what Projector promises, on the virtual one, on the DLPC900 driver and on a screen
// with their strict models, and on those whose light the stage's board times.
namespace telefab::fab {
namespace {

using namespace std::chrono_literals;
using test::FormulaMasks;
using test::PrintRig;

struct VirtualEngine {
  VirtualClock clock;
  MachineLog log;
  std::unique_ptr<Projector> projector = std::make_unique<VirtualProjector>(PrintRig::kSize, 0.0, clock, log);
};

struct Dlpc900Engine {
  VirtualClock clock;
  MachineLog log;
  Dlpc900Model model{1, 6, clock, &log};
  std::unique_ptr<Projector> projector = Dlpc900Projector::open(std::make_unique<ModelUsb>(model, clock),
                                                                {.mask = PrintRig::kSize, .led_current = 10}, clock)
                                             .value();
};

/// A screen whose lamp is always on: its picture is the light.
struct ScreenEngine {
  VirtualClock clock;
  MachineLog log;
  test::ScreenModel model{PrintRig::kSize, clock, log};
  std::unique_ptr<Projector> projector =
      ScreenProjector::open(std::make_unique<test::ModelDisplay>(model),
                            {PrintRig::kSize, {PrintRig::kSize, {}, {}, {}}, 0}, clock)
          .value();
};

/// The light is the lamp at the board, whose stage is homed.
template <test::ShownBy kShown, test::LitBy kLit>
struct StageLitEngine {
  StageLitEngine() {
    EXPECT_TRUE(rig.connect());
    EXPECT_TRUE(rig.stage->home());
    while (rig.stage->poll()->moving) clock.sleep_for(10ms);
  }
  test::StageLitRig rig{kShown, kLit, 1};
  VirtualClock& clock = rig.clock;
  MachineLog& log = rig.log;
  std::unique_ptr<Projector>& projector = rig.projector;
};
using ScreenAndGrbl = StageLitEngine<test::ShownBy::Screen, test::LitBy::GrblSpindle>;
using ScreenAndMarlin = StageLitEngine<test::ShownBy::Screen, test::LitBy::MarlinFan>;
using Dlpc900AndGrbl = StageLitEngine<test::ShownBy::Dlpc900, test::LitBy::GrblSpindle>;
using Dlpc900AndMarlin = StageLitEngine<test::ShownBy::Dlpc900, test::LitBy::MarlinPin>;

template <class Engine>
class ProjectorContract : public testing::Test {
 protected:
  /// Polls until the state is reached; false after a minute of the machine's time.
  bool reaches(LightState state) {
    for (int i = 0; i < 6000; ++i) {
      const auto status = engine.projector->poll();
      if (!status) return false;
      if (status->state == state) return true;
      engine.clock.sleep_for(10ms);
    }
    return false;
  }
  Result<void> load(Microseconds exposure) {
    const auto mask = masks.mask(LayerIndex{0});
    return engine.projector->load(mask->view(), {exposure});
  }
  [[nodiscard]] Nanoseconds lit() const {
    Nanoseconds sum{};
    for (const auto& span : engine.log.light()) sum += span.until - span.from;
    return sum;
  }

  Engine engine;
  FormulaMasks masks{PrintRig::kSize};
};
using Engines = testing::Types<VirtualEngine, Dlpc900Engine, ScreenEngine, ScreenAndGrbl, ScreenAndMarlin,
                               Dlpc900AndGrbl, Dlpc900AndMarlin>;
TYPED_TEST_SUITE(ProjectorContract, Engines);

TYPED_TEST(ProjectorContract, ShowsNothingBeforeItIsAskedTo) {
  ASSERT_TRUE(this->load(200ms));
  ASSERT_TRUE(this->reaches(LightState::Loaded));
  this->engine.clock.sleep_for(1s);
  EXPECT_EQ(this->lit(), 0ns);
}

TYPED_TEST(ProjectorContract, EndsTheExposureByItselfAfterTheTimeGiven) {
  ASSERT_TRUE(this->load(200ms));
  ASSERT_TRUE(this->reaches(LightState::Loaded));
  ASSERT_TRUE(this->engine.projector->expose());
  ASSERT_TRUE(this->reaches(LightState::Exposed));
  this->engine.clock.sleep_for(10s);
  (void)this->engine.projector->poll();
  EXPECT_NEAR(std::chrono::duration<double>(this->lit()).count(), 0.2, 0.002);
}

TYPED_TEST(ProjectorContract, RefusesToExposeWithoutALoadedMask) {
  EXPECT_FALSE(this->engine.projector->expose());
  EXPECT_EQ(this->lit(), 0ns);
}

TYPED_TEST(ProjectorContract, RefusesAMaskOfAnotherSizeAndAnExposureThatIsNotPositive) {
  const Mask wrong{{3, 3}, std::vector<std::uint8_t>(9)};
  EXPECT_EQ(this->engine.projector->load(wrong.view(), {200ms}).error().code, ErrorCode::InvalidInput);
  EXPECT_EQ(this->load(0us).error().code, ErrorCode::InvalidInput);
}

TYPED_TEST(ProjectorContract, GoesDarkInTheMiddleOfAnExposureAndForgetsTheMask) {
  ASSERT_TRUE(this->load(2s));
  ASSERT_TRUE(this->reaches(LightState::Loaded));
  ASSERT_TRUE(this->engine.projector->expose());
  this->engine.clock.sleep_for(500ms);
  ASSERT_TRUE(this->engine.projector->dark());
  this->engine.clock.sleep_for(10s);
  EXPECT_LT(this->lit(), 600ms);
  EXPECT_GT(this->lit(), 0ns);
  EXPECT_FALSE(this->engine.projector->expose());
}

TYPED_TEST(ProjectorContract, IsDarkAfterItsEnd) {
  ASSERT_TRUE(this->load(2s));
  ASSERT_TRUE(this->reaches(LightState::Loaded));
  ASSERT_TRUE(this->engine.projector->expose());
  this->engine.clock.sleep_for(100ms);
  this->engine.projector.reset();
  this->engine.clock.sleep_for(10s);
  EXPECT_LT(this->lit(), 300ms);
}

TYPED_TEST(ProjectorContract, TakesDarkInEveryStateAnyNumberOfTimes) {
  EXPECT_TRUE(this->engine.projector->dark());
  EXPECT_TRUE(this->engine.projector->dark());
  ASSERT_TRUE(this->load(200ms));
  EXPECT_TRUE(this->engine.projector->dark());
  EXPECT_TRUE(this->load(200ms));
  EXPECT_TRUE(this->reaches(LightState::Loaded));
}

}  // namespace
}  // namespace telefab::fab
