// SPDX-License-Identifier: GPL-3.0-or-later
#include <fmt/format.h>
#include <gtest/gtest.h>

#include <cmath>
#include <random>
#include <telefab/fab/device/virtual_projector.hpp>
#include <telefab/fab/device/virtual_z_stage.hpp>
#include <telefab/fab/drivers/marlin_model.hpp>
#include <telefab/fab/print/admission.hpp>
#include <telefab/fab/print/print_time.hpp>
#include <telefab/test/print_rig.hpp>

namespace telefab::fab {
namespace {

using namespace std::chrono_literals;
using test::PrintRig;

TEST(ModelPrint, GivesFiftyLayersTheirDoseAndNothingElse) {
  PrintRig rig{50};
  rig.projector_model.add_up_dose(true);
  ASSERT_TRUE(rig.connect());
  const auto record = rig.print();
  ASSERT_TRUE(record);
  ASSERT_EQ(record->outcome, PrintOutcome::Done) << record->cause.what;
  EXPECT_TRUE(compare(*record, rig.plan).empty());
  const PixelSize mirrors = rig.projector_model.mirrors();
  std::vector<double> ordered(std::size_t{mirrors.width_px} * mirrors.height_px);
  for (const PlannedLayer& layer : rig.plan.layers) {
    const Mask mask = place_on_mirrors(rig.masks.mask(layer.index)->view(), mirrors, OpticsTurn::Normal);
    for (std::size_t i = 0; i < ordered.size(); ++i) ordered[i] += 0.7 * mask.rows[i] / 255;
  }
  const auto dose = rig.projector_model.dose_s();
  int lit = 0;
  for (std::size_t i = 0; i < ordered.size(); ++i) {
    if (ordered[i] == 0)
      ASSERT_EQ(dose[i], 0) << i;
    else
      ASSERT_NEAR(dose[i] / ordered[i], 1, 0.01) << i;
    lit += ordered[i] > 0;
  }
  EXPECT_GT(lit, 1000);
  EXPECT_EQ(rig.log.light_while_moving(), 0ns);
  EXPECT_EQ(rig.projector_model.refusals(), 0u);
}

TEST(ModelPrint, GivesAnExposureLongerThanTheDeviceTimesItsWholeDoseInParts) {
  PrintRig rig{2, 36s};
  ASSERT_TRUE(rig.connect());
  const auto record = rig.print();
  ASSERT_TRUE(record);
  ASSERT_EQ(record->outcome, PrintOutcome::Done) << record->cause.what;
  EXPECT_TRUE(compare(*record, rig.plan).empty());
  EXPECT_EQ(record->layers[0].parts, 3u);
  Nanoseconds lit{};
  for (const LitSpan& span : rig.log.light()) lit += span.until - span.from;
  EXPECT_EQ(rig.log.light().size(), 6u);
  EXPECT_NEAR(double(lit.count()), 72e9, 1e6);
  EXPECT_EQ(rig.log.light_while_moving(), 0ns);
}

/// Noise over part of the platform: what hardly compresses.
class NoiseMasks final : public MaskSource {
 public:
  explicit NoiseMasks(std::uint32_t side) : side_{side} {}
  Result<Mask> mask(LayerIndex layer) override {
    Mask m{kSize, std::vector<std::uint8_t>(std::size_t{kSize.width_px} * kSize.height_px)};
    std::mt19937 rng{layer.count()};
    const std::uint32_t side = layer.count() % 2 == 0 ? side_ : side_ / 4;
    for (std::uint32_t y = 0; y < side; ++y)
      for (std::uint32_t x = 0; x < side; ++x)
        m.rows[std::size_t{y} * kSize.width_px + x] = static_cast<std::uint8_t>(rng());
    return m;
  }
  static constexpr PixelSize kSize{800, 600};

 private:
  std::uint32_t side_;
};

TEST(ModelPrint, TakesTheTimeItWasAdmittedForWhereTheBusIsTheBottleneck) {
  VirtualClock clock;
  MachineLog log;
  Dlpc900Model model{1, 6, clock, &log};
  model.add_up_dose(false);
  GrblModel board{25, clock, &log};
  NoiseMasks masks{400};
  PrintPlan plan;
  plan.mask_size = NoiseMasks::kSize;
  plan.z_travel_mm = 20;
  for (std::uint32_t i = 0; i < 12; ++i) {
    const Mask mask = *masks.mask(LayerIndex{i});
    plan.layers.push_back({LayerIndex{i}, 0.1 * (i + 1), 700ms, digest_of(std::as_bytes(std::span{mask.rows}))});
  }
  auto projector = Dlpc900Projector::open(std::make_unique<ModelUsb>(model, clock), {.mask = plan.mask_size}, clock);
  ASSERT_TRUE(projector);
  auto stage =
      SerialStage::open(std::make_unique<ModelLine>(board, clock), {.top_mm = 25, .homing_mm_per_s = 20}, clock);
  ASSERT_TRUE(stage);
  const auto admission = estimate_print(plan, {}, masks, **projector, **stage, {}, {});
  ASSERT_TRUE(admission) << admission.error().what;
  EXPECT_EQ(admission->too_slow.size(), 6u) << "every second mask is 480 kB";
  EXPECT_GT(admission->slowdown(), 1.2);
  EXPECT_FALSE(admit(*admission, 1.1));
  EXPECT_TRUE(admit(*admission, 2));

  PrintJournal journal = *PrintJournal::open(memory_journal_file());
  PrintRunner runner{**projector, **stage, masks, journal, clock};
  PrintControl control;
  const Nanoseconds from = clock.now();
  const auto record = runner.run(plan, {}, control, {}, {});
  ASSERT_TRUE(record);
  ASSERT_EQ(record->outcome, PrintOutcome::Done) << record->cause.what;
  const double ratio = double((clock.now() - from).count()) / double(admission->expected.count());
  fmt::print("estimated {:.1f} s, took {:.3f} of it\n", double(admission->expected.count()) * 1e-9, ratio);
  EXPECT_NEAR(ratio, 1, 0.05);
}

/// A machine's motion, as its profile states it, on a small light engine.
struct TimedMachine {
  const char* name;
  MachineProfile profile;
};

TimedMachine timed(const char* name, auto change) {
  TimedMachine machine{name, {}};
  machine.profile.platform.z_travel_mm = 60;
  machine.profile.layers.thickness_mm = 0.05;
  machine.profile.motion.homing_speed_mm_per_s = 20;
  change(machine.profile);
  return machine;
}

/// The stages of the machine, each on a clock of its own.
enum class StageOf : std::uint8_t { Virtual, Grbl, Marlin };

double simulated_s(const MachineProfile& machine, StageOf kind, const PrintPlan& plan, MaskSource& masks) {
  VirtualClock clock;
  MachineLog log;
  const StagePace pace = stage_pace(machine);
  const double acceleration = machine.motion.acceleration_mm_per_s2;
  VirtualProjector projector{PrintRig::kSize, 0, clock, log};
  GrblModel grbl{pace.top_mm, clock, &log};
  MarlinModel marlin{pace.top_mm, clock, &log};
  grbl.set_acceleration(acceleration);
  marlin.set_acceleration(acceleration);
  std::unique_ptr<ZStage> stage;
  if (kind == StageOf::Virtual) {
    stage = std::make_unique<VirtualZStage>(pace.top_mm, clock, log,
                                            VirtualStageOptions{pace.homing_mm_per_s, acceleration});
  } else {
    LineModel& model = kind == StageOf::Grbl ? static_cast<LineModel&>(grbl) : marlin;
    auto opened = SerialStage::open(std::make_unique<ModelLine>(model, clock),
                                    {.dialect = kind == StageOf::Grbl ? StageDialect::Grbl : StageDialect::Marlin,
                                     .top_mm = pace.top_mm,
                                     .homing_mm_per_s = pace.homing_mm_per_s,
                                     .acceleration_mm_per_s2 = acceleration},
                                    clock);
    EXPECT_TRUE(opened) << opened.error().what;
    stage = std::move(*opened);
  }
  PrintJournal journal = *PrintJournal::open(memory_journal_file());
  PrintRunner runner{projector, *stage, masks, journal, clock};
  PrintControl control;
  const Nanoseconds from = clock.now();
  const auto record = runner.run(plan, {}, control, {}, {});
  EXPECT_TRUE(record && record->outcome == PrintOutcome::Done) << (record ? record->cause.what : record.error().what);
  EXPECT_EQ(log.light_while_moving(), 0ns);
  EXPECT_EQ(log.light().size(), plan.layers.size());
  return double((clock.now() - from).count()) * 1e-9;
}

TEST(ModelPrint, TakesTheEstimatedTimeOnEveryStageWhateverTheMotion) {
  const TimedMachine machines[] = {
      timed("plain lift, no acceleration stated", [](MachineProfile&) {}),
      timed("two-stage film printer",
            [](MachineProfile& m) {
              auto& motion = m.motion;
              motion.lift_mm = 8, motion.lift_speed_mm_per_s = 3;
              motion.peel_mm = 3, motion.peel_speed_mm_per_s = 1;
              motion.approach_mm = 2, motion.approach_speed_mm_per_s = 0.8;
              motion.wait_after_exposure_s = 0.5, motion.wait_after_lift_s = 1;
              motion.bottom.peel_speed_mm_per_s = 0.5, motion.bottom.settle_s = 3;
              motion.large_area_mm2 = 10, motion.large.lift_mm = 10, motion.large.lift_speed_mm_per_s = 1.5;
              motion.acceleration_mm_per_s2 = 50;
              m.layers.transition_count = 5;
            }),
      timed("quick stage that speeds up slowly",
            [](MachineProfile& m) {
              auto& motion = m.motion;
              motion.lift_mm = 4, motion.lift_speed_mm_per_s = 6, motion.lower_speed_mm_per_s = 8;
              motion.settle_s = 0.2, motion.acceleration_mm_per_s2 = 8;
            }),
  };
  test::FormulaMasks masks{PrintRig::kSize};
  for (const TimedMachine& machine : machines) {
    MachineProfile profile = machine.profile;
    profile.layers.bottom_exposure_s = 12, profile.layers.exposure_s = 1.5;
    PrintPlan plan = test::formula_plan(masks, PrintRig::kSize, 40, 1500ms);
    plan.z_travel_mm = profile.platform.z_travel_mm;
    plan.acceleration_mm_per_s2 = profile.motion.acceleration_mm_per_s2;
    for (PlannedLayer& layer : plan.layers) {
      const std::uint32_t k = layer.index.count();
      layer.exposure = Microseconds{std::llround(profile.exposure_of_layer_s(k) * 1e6)};
      layer.motion = motion_of(profile.motion, k < profile.layers.bottom_count, k % 3 == 0 ? 20 : 5);
    }
    const double estimate_s = double(print_time(plan, {}, stage_pace(profile), {}).count()) * 1e-9;
    for (const StageOf kind : {StageOf::Virtual, StageOf::Grbl, StageOf::Marlin}) {
      const double took_s = simulated_s(profile, kind, plan, masks);
      fmt::print("{:36} {:8} estimated {:6.1f} s, took {:6.1f} s: {:+.2f} %\n", machine.name,
                 kind == StageOf::Virtual ? "virtual"
                 : kind == StageOf::Grbl  ? "GRBL"
                                          : "Marlin",
                 estimate_s, took_s, (took_s / estimate_s - 1) * 100);
      EXPECT_NEAR(took_s / estimate_s, 1, 0.03);
    }
  }
}

}  // namespace
}  // namespace telefab::fab
