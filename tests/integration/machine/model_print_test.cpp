// SPDX-License-Identifier: GPL-3.0-or-later
#include <fmt/format.h>
#include <gtest/gtest.h>

#include <random>
#include <telefab/fab/print/admission.hpp>
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
  plan.motion = {5.0, 2.0, 3.0, 0.5};
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

}  // namespace
}  // namespace telefab::fab
