// SPDX-License-Identifier: GPL-3.0-or-later
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <atomic>
#include <cmath>
#include <nlohmann/json.hpp>
#include <numeric>
#include <telefab/fab/cure/dose_field.hpp>
#include <telefab/fab/mask/raster.hpp>
#include <telefab/fab/planning/plan_job.hpp>
#include <telefab/fab/print/print_time.hpp>
#include <telefab/test/block_stack.hpp>
#include <telefab/test/overlooked.hpp>

namespace telefab::fab {
namespace {

using testing::HasSubstr;
using namespace std::chrono_literals;

struct Planned {
  Result<PlanSummary> summary;
  std::vector<std::vector<std::byte>> pngs;
};

Planned plan(const LayerStack& stack, PlanOptions options = {}, const MachineProfile& machine = test::small_machine(),
             std::stop_token stop = {}) {
  const VirtualClock clock;
  Planned planned{fail(ErrorCode::Internal, ""), {}};
  const auto keep = [&](const PlannedImage& layer_image) -> Result<void> {
    if (layer_image.index.count() == 0) planned.pngs.clear();
    EXPECT_EQ(layer_image.index.count(), planned.pngs.size());
    planned.pngs.emplace_back(layer_image.png.begin(), layer_image.png.end());
    return {};
  };
  planned.summary = plan_job(stack, machine, options, keep, clock, {}, stop);
  return planned;
}

PlanOptions without_supports() {
  PlanOptions options;
  options.supports.mode = SupportOptions::Mode::None;
  return options;
}

TEST(PlanJob, GivesBottomLayersTheLongerExposureAndEmptyLayersNone) {
  std::vector<std::vector<Contour>> rings(6, {test::rectangle(5, 5, 15, 15)});
  rings[4].clear();
  const Planned planned = plan(test::stack_of(rings), without_supports());
  ASSERT_TRUE(planned.summary) << planned.summary.error().what;
  std::vector<std::chrono::microseconds> exposures;
  for (const PlannedLayer& layer : planned.summary->plan.layers) exposures.push_back(layer.exposure);
  EXPECT_THAT(exposures, testing::ElementsAre(8s, 8s, 8s, 2s, 0s, 2s));
  EXPECT_DOUBLE_EQ(planned.summary->plan.layers[5].z_mm, 6 * 0.1);
}

TEST(PlanJob, DigestsAndPicturesAreThoseOfTheMasks) {
  const LayerStack stack = test::table(3, 2);
  PlanOptions options = without_supports();
  options.masks = MaskMethod::Cover;
  const Planned planned = plan(stack, options);
  ASSERT_TRUE(planned.summary);
  for (std::size_t i = 0; i < 5; ++i) {
    const Mask mask = rasterise(stack.layers()[i].contours, mask_frame(test::small_machine()));
    EXPECT_EQ(decode_png(planned.pngs[i], 1'000'000)->pixels, mask.rows);
    EXPECT_EQ(planned.summary->plan.layers[i].mask, digest_of(std::as_bytes(std::span{mask.rows})));
  }
}

TEST(PlanJob, HoldsAnOverhangBySupportsAndTheCheckPasses) {
  const Planned planned = plan(test::table(30, 10));
  ASSERT_TRUE(planned.summary) << planned.summary.error().what;
  EXPECT_GT(planned.summary->anchors.size(), 2U);
  EXPECT_TRUE(planned.summary->check.passes());
  EXPECT_GT(planned.summary->figures.support_mm3, 0);
}

TEST(PlanJob, SeesWhatFloatsWhereNothingHoldsIt) {
  std::vector<std::vector<Contour>> rings(10, {test::rectangle(5, 5, 15, 15)});
  for (std::size_t i = 5; i < 10; ++i) rings[i].push_back(test::rectangle(20, 20, 22, 22));
  const Planned planned = plan(test::stack_of(rings), without_supports());
  ASSERT_TRUE(planned.summary);
  EXPECT_FALSE(planned.summary->check.passes());
  EXPECT_EQ(planned.summary->check.count(Finding::Kind::Island), 1U);
}

TEST(PlanJob, GivesNoLightToASpeckThatWouldFloat) {
  for (const MaskMethod method : {MaskMethod::Cover, MaskMethod::BlendStack}) {
    test::Overlooked part{0.3, 1};
    part.options.masks = method;
    const Planned planned = plan(part.stack, part.options);
    ASSERT_TRUE(planned.summary) << planned.summary.error().what;
    EXPECT_EQ(planned.summary->specks, 1U);
    EXPECT_EQ(planned.summary->anchors.size(), 0U);
    EXPECT_TRUE(planned.summary->check.passes());
    const Image image = decode_png(planned.pngs[5], 1'000'000).value();
    std::uint8_t brightest = 0;
    for (std::size_t y = 80; y < 120; ++y)
      for (std::size_t x = 190; x < 220; ++x) brightest = std::max(brightest, image.pixels[y * image.width_px + x]);
    EXPECT_LT(brightest, gel_level(test::small_machine(), 2) / 2) << name_of(method);
    EXPECT_EQ(planned.summary->plan.layers[5].mask, digest_of(std::as_bytes(std::span{image.pixels})));
    EXPECT_EQ(image.pixels[std::size_t{200} * image.width_px + 100], 255);  // the block
  }
}

TEST(PlanJob, SpendsNoLightOnAHoleInNothing) {
  // An open scan may give the inner side of a wall alone.
  const Contour outer = test::rectangle(20, 20, 30, 30);
  const Contour hole = Contour::from_vertices({outer.vertices().rbegin(), outer.vertices().rend()}).value();
  std::vector<std::vector<Contour>> rings(10, {test::rectangle(5, 5, 15, 15)});
  const Planned alone = plan(test::stack_of(rings), without_supports());
  for (std::size_t i = 4; i < 10; ++i) rings[i].push_back(hole);
  const Planned both = plan(test::stack_of(rings), without_supports());
  ASSERT_TRUE(alone.summary);
  ASSERT_TRUE(both.summary);
  EXPECT_TRUE(both.summary->check.passes());
  EXPECT_DOUBLE_EQ(both.summary->cured_mm3, alone.summary->cured_mm3);
}

TEST(PlanJob, IsTheSameOnOneTwoAndEightThreads) {
  const LayerStack stack = test::table(30, 10);
  PlanOptions options;
  options.threads = 1;
  const Planned one = plan(stack, options);
  ASSERT_TRUE(one.summary);
  for (const int threads : {2, 8}) {
    options.threads = threads;
    const Planned other = plan(stack, options);
    ASSERT_TRUE(other.summary);
    EXPECT_EQ(other.pngs, one.pngs);
    EXPECT_EQ(plan_digest(other.summary->plan), plan_digest(one.summary->plan));
    EXPECT_EQ(other.summary->supports_json, one.summary->supports_json);
  }
}

TEST(PlanJob, RefusesAPartLargerThanTheMachineWithBothSizes) {
  MachineProfile machine = test::small_machine();
  machine.platform.width_mm = 20;
  EXPECT_THAT(plan(test::table(3, 3), {}, machine).summary.error().what,
              testing::AllOf(HasSubstr("23.00"), HasSubstr("20 x 30 mm")));
  machine = test::small_machine();
  machine.platform.z_travel_mm = 0.4;
  EXPECT_THAT(plan(test::table(3, 3), {}, machine).summary.error().what, HasSubstr("0.4 mm"));
  machine = test::small_machine();
  machine.layers.thickness_mm = 0.05;
  EXPECT_THAT(plan(test::table(3, 3), {}, machine).summary.error().what, HasSubstr("0.05 mm"));
}

TEST(PlanJob, JudgesTheSizeByTheContoursAndNotByTheSlicersWiderBox) {
  // The stack's header says 40 x 30 mm; its contours end at 23 x 15 mm.
  MachineProfile machine = test::small_machine();
  machine.platform.width_mm = 23 - machine.projection.pixel_pitch_mm / 4;
  EXPECT_TRUE(plan(test::table(3, 3), without_supports(), machine).summary);
  machine.platform.width_mm = 23 - machine.projection.pixel_pitch_mm;
  EXPECT_FALSE(plan(test::table(3, 3), without_supports(), machine).summary);
}

TEST(PlanJob, StopsWhenAskedAndHandsOnTheSinksError) {
  std::stop_source stop;
  stop.request_stop();
  EXPECT_EQ(plan(test::table(3, 3), {}, test::small_machine(), stop.get_token()).summary.error().code,
            ErrorCode::Cancelled);
  const VirtualClock clock;
  const auto full = [](const PlannedImage&) -> Result<void> {
    return fail(ErrorCode::StorageFailed, "the disk is full");
  };
  EXPECT_EQ(plan_job(test::table(3, 3), test::small_machine(), {}, full, clock, {}, {}).error().code,
            ErrorCode::StorageFailed);
}

TEST(PlanJob, MasksOfEveryMethodAreTheSameOnAnyNumberOfThreads) {
  const LayerStack stack = test::table(40, 20);
  for (const MaskMethod method : {MaskMethod::Cover, MaskMethod::Blend, MaskMethod::BlendStack}) {
    PlanOptions options = without_supports();
    options.masks = method;
    options.threads = 1;
    const Planned one = plan(stack, options);
    ASSERT_TRUE(one.summary) << one.summary.error().what;
    options.threads = 3;
    EXPECT_EQ(plan(stack, options).pngs, one.pngs) << name_of(method);
    EXPECT_EQ(mask_method_from_name(name_of(method)).value(), method);
  }
}

TEST(PlanJob, LeavesLayersOverAVoidDarkWhereLaterLightCuresThem) {
  const std::uint32_t foot = 30;
  const auto grey_over_void = [&](bool compensate, std::uint32_t layer) {
    PlanOptions options = without_supports();
    options.compensate_undersides = compensate;
    const Planned planned = plan(test::table(foot, 12), options);
    const auto image = decode_png(planned.pngs[layer], 1'000'000).value();
    return image.pixels[std::size_t{200} * image.width_px + 190];  // (19, 10) mm
  };
  EXPECT_EQ(grey_over_void(true, foot), 0);
  EXPECT_EQ(grey_over_void(true, foot + 8), 255);
  EXPECT_EQ(grey_over_void(false, foot), 255);
  EXPECT_EQ(grey_over_void(false, foot - 1), 0);
}

/// What cures of every layer: pixels that all light together cures to the layer's middle, and to its far side.
struct Cured {
  std::vector<std::vector<bool>> middles, through;  // bottom first
};
Cured cured(const Planned& planned, const MachineProfile& machine) {
  const CureModel model = cure_model(machine).value();
  DoseStream stream{model};
  Cured all{std::vector<std::vector<bool>>(planned.pngs.size()), std::vector<std::vector<bool>>(planned.pngs.size())};
  for (std::size_t n = planned.pngs.size(); n-- > 0;) {
    const Image image = decode_png(planned.pngs[n], 1'000'000).value();
    const MaskExposure exposure{{model.mask, image.pixels}, planned.summary->plan.layers[n].exposure};
    const DoseField dose = stream.descend({&exposure, 1}).value();
    for (std::uint32_t y = 0; y < model.mask.height_px; ++y)
      for (std::uint32_t x = 0; x < model.mask.width_px; ++x) {
        const double d = dose.sample({x + 0.5, y + 0.5}).dose;
        all.middles[n].push_back(d >= model.to_middle());
        all.through[n].push_back(d >= model.through());
      }
  }
  return all;
}

TEST(PlanJob, PatternsTakeLightFromTheInsideAndNothingFromWhatCures) {
  const MachineProfile machine = test::small_machine();
  const LayerStack stack = test::stack_of(std::vector<std::vector<Contour>>(44, {test::rectangle(5, 5, 15.04, 14.97)}));
  PlanOptions options = without_supports();
  const Planned solid = plan(stack, options, machine);
  const Cured all = cured(solid, machine);
  const auto light_of = [](const Planned& planned) {
    double sum = 0;
    for (const auto& png : planned.pngs) {
      const Image image = decode_png(png, 1'000'000).value();
      sum = std::accumulate(image.pixels.begin(), image.pixels.end(), sum);
    }
    return sum;
  };
  for (const auto kind : {InnerPattern::Kind::Checker, InnerPattern::Kind::ShellCore}) {
    options.pattern.kind = kind;
    const Planned planned = plan(stack, options, machine);
    ASSERT_TRUE(planned.summary) << planned.summary.error().what;
    EXPECT_LT(light_of(planned), 0.95 * light_of(solid));
    const Cured some = cured(planned, machine);
    EXPECT_EQ(some.middles, all.middles) << name_of(kind);
    EXPECT_EQ(some.through, all.through) << name_of(kind);
    EXPECT_TRUE(planned.summary->check.passes());
    EXPECT_EQ(planned.summary->check.count(Finding::Kind::ResinTrap), 0U);
    EXPECT_DOUBLE_EQ(planned.summary->cured_mm3, solid.summary->cured_mm3);
    EXPECT_EQ(nlohmann::json::parse(to_json(*planned.summary))["masks"]["pattern"], name_of(kind));
    options.threads = 3;
    EXPECT_EQ(plan(stack, options, machine).pngs, planned.pngs);
    options.threads = 0;
  }
}

TEST(PlanJob, RefusesAPatternThatNothingComputesTheLightFor) {
  PlanOptions options = without_supports();
  options.pattern.kind = InnerPattern::Kind::Checker;
  options.masks = MaskMethod::Cover;
  EXPECT_THAT(plan(test::table(3, 3), options).summary.error().what, HasSubstr("needs masks by blend-stack"));
}

/// A clock that goes on by a millisecond whenever somebody looks.
class HurryingClock final : public Clock {
 public:
  [[nodiscard]] Nanoseconds now() const override { return Nanoseconds{1ms * ++looks_}; }
  [[nodiscard]] Nanoseconds wall() const override { return now(); }
  void sleep_for(Nanoseconds) override {}

 private:
  mutable std::atomic<int> looks_{0};
};

TEST(PlanJob, StopsSolvingAMaskAtItsDeadlineAndKeepsTheCoverOfTheRest) {
  const LayerStack stack = test::table(6, 3);
  for (const MaskMethod method : {MaskMethod::Blend, MaskMethod::BlendStack}) {
    PlanOptions options = without_supports();
    options.masks = method;
    options.threads = 1;
    options.mask_deadline = 5ms;
    const HurryingClock clock;
    std::size_t layers = 0;
    const auto count = [&](const PlannedImage&) -> Result<void> {
      ++layers;
      return {};
    };
    const auto hurried = plan_job(stack, test::small_machine(), options, count, clock, {}, {});
    ASSERT_TRUE(hurried) << hurried.error().what;
    EXPECT_EQ(layers, 9U);  // none is missing
    // One look starts a layer, and the sixth after it is the first to find time out.
    EXPECT_LE(hurried->mask_figures.tiles, 9U * 4);
    EXPECT_GT(hurried->mask_figures.unsolved, 0U);
    const auto masks = nlohmann::json::parse(to_json(*hurried))["masks"];
    EXPECT_EQ(masks["deadline_reached"], true);
    EXPECT_EQ(masks["tiles_left_as_cover"], hurried->mask_figures.unsolved);
  }
}

TEST(PlanJob, ReportsWhatTheSolverReachedAndWhatTimeLeftUndone) {
  const auto report = [](const PlanOptions& options) {
    return nlohmann::json::parse(to_json(*plan(test::table(6, 3), options).summary))["masks"];
  };
  const auto solved = report(without_supports());
  EXPECT_EQ(solved["method"], "blend-stack");
  EXPECT_EQ(solved["deadline_reached"], false);
  EXPECT_GT(solved["tiles_solved"], 0);
  PlanOptions hurried = without_supports();
  hurried.mask_deadline = std::chrono::nanoseconds{1};
  EXPECT_EQ(report(hurried)["deadline_reached"], false);  // the test's clock stands still
}

TEST(PlanJob, ReportsWhatItsResinCostsWhereThatHasAPrice) {
  PlanOptions options = without_supports();
  EXPECT_TRUE(nlohmann::json::parse(to_json(*plan(test::table(6, 3), options).summary))["cost"].is_null());
  options.price = ResinPrice{50, "EUR"};
  const auto report = nlohmann::json::parse(to_json(*plan(test::table(6, 3), options).summary));
  EXPECT_EQ(report["cost"]["currency"], "EUR");
  EXPECT_DOUBLE_EQ(report["cost"]["amount"].get<double>(), report["cured_mm3"].get<double>() / 1000 * 50 / 1000);
}

TEST(PlanJob, TakesExposuresFromACureDepthWhereOneIsAsked) {
  PlanOptions options = without_supports();
  options.cure_depth_layers = 3;
  const Planned planned = plan(test::table(3, 3), options);
  ASSERT_TRUE(planned.summary);
  const double seconds = 5 * std::exp(3 * 0.1 / 0.2) / 10;  // Ec exp(depth / Dp) / irradiance
  EXPECT_NEAR(std::chrono::duration<double>(planned.summary->plan.layers[5].exposure).count(), seconds, 1e-6);
  EXPECT_NEAR(std::chrono::duration<double>(planned.summary->plan.layers[0].exposure).count(), 4 * seconds, 1e-5);
  EXPECT_NEAR(planned.summary->cure_depth_mm, 0.3, 1e-9);
}

TEST(PlanJob, RefusesOptionsOutOfRange) {
  const auto refused = [](auto change) {
    PlanOptions options;
    change(options);
    const auto planned = plan(test::table(3, 3), options);
    return !planned.summary && planned.summary.error().code == ErrorCode::InvalidInput;
  };
  EXPECT_TRUE(refused([](PlanOptions& o) { o.mask_iterations = 0; }));
  EXPECT_TRUE(refused([](PlanOptions& o) { o.support_grey = 0; }));
  EXPECT_TRUE(refused([](PlanOptions& o) { o.cure_depth_layers = 21; }));
  EXPECT_TRUE(refused([](PlanOptions& o) { o.mask_deadline = std::chrono::nanoseconds{-1}; }));
}

TEST(PlanJob, CountsThePrintsTimeFromExposuresAndMotion) {
  MachineProfile machine = test::small_machine();
  machine.motion = {6, 2, 3, 0.5};
  const Planned planned = plan(test::stack_of(std::vector<std::vector<Contour>>(4, {test::rectangle(5, 5, 15, 15)})),
                               without_supports(), machine);
  ASSERT_TRUE(planned.summary);
  EXPECT_DOUBLE_EQ(planned.summary->exposure_s, 3 * 8.0 + 2.0);
  const double top_mm = machine.platform.z_travel_mm + 6, z_mm = 4 * machine.layers.thickness_mm;
  const double ways_s =
      top_mm / 20 + (top_mm - z_mm / 4) / 3 + 4 * 6 / 2.0 + 3 * (6 - z_mm / 4) / 3 + (top_mm - z_mm - 6) / 20;
  EXPECT_NEAR(planned.summary->print_s, 26.0 + 4 * 0.5 + ways_s, 1e-6);
}

TEST(PlanJob, GivesEveryLayerTheMotionOfItsPlaceAndItsArea) {
  MachineProfile machine = test::small_machine();
  machine.layers.bottom_count = 2;
  machine.motion.bottom.lift_mm = 7;
  machine.motion.large_area_mm2 = 50;
  machine.motion.large.lift_mm = 9;
  machine.motion.acceleration_mm_per_s2 = 40;
  const std::vector<Contour> wide{test::rectangle(5, 5, 15, 15)}, narrow{test::rectangle(8, 8, 12, 12)};
  const Planned planned = plan(test::stack_of({wide, wide, wide, narrow, narrow}), without_supports(), machine);
  ASSERT_TRUE(planned.summary);
  std::vector<double> lifts;
  for (const PlannedLayer& layer : planned.summary->plan.layers) lifts.push_back(layer.motion.lift_mm);
  EXPECT_EQ(lifts, (std::vector<double>{7, 7, 9, 5, 5}));
  EXPECT_EQ(planned.summary->plan.acceleration_mm_per_s2, 40);
  EXPECT_EQ(planned.summary->print_s,
            std::chrono::duration<double>(print_time(planned.summary->plan, {}, stage_pace(machine), {})).count());
}

TEST(PlanJob, MakesTheSameMasksForTheSameDosesAtLessLight) {
  MachineProfile machine = test::small_machine();
  machine.layers.bottom_count = 2;
  machine.layers.transition_count = 2;
  const auto stack = test::stack_of(std::vector<std::vector<Contour>>(6, {test::rectangle(5.03, 5, 15.02, 15)}));
  MachineProfile dimmed = machine;
  dimmed.layers.light_share = 0.5;
  dimmed.layers.bottom_light_share = 0.8;
  dimmed.layers.exposure_s /= 0.5;
  dimmed.layers.bottom_exposure_s /= 0.8;
  const Planned full = plan(stack, without_supports(), machine), less = plan(stack, without_supports(), dimmed);
  ASSERT_TRUE(full.summary && less.summary);
  EXPECT_EQ(less.summary->white_dose_mj_per_cm2, full.summary->white_dose_mj_per_cm2);
  for (std::size_t k = 0; k < 6; ++k) {
    const PlannedLayer &a = full.summary->plan.layers[k], &b = less.summary->plan.layers[k];
    EXPECT_EQ(a.mask, b.mask) << k;
    EXPECT_EQ(a.light_share, 1);
    EXPECT_EQ(b.light_share, k < 2 ? 0.8 : 0.5);
    EXPECT_NEAR(double(b.exposure_at_full_light().count()), double(a.exposure_at_full_light().count()), 2000);
  }
  const auto& layers = full.summary->plan.layers;
  EXPECT_GT(layers[1].exposure, layers[2].exposure);
  EXPECT_GT(layers[2].exposure, layers[3].exposure);
  EXPECT_GT(layers[3].exposure, layers[4].exposure);
}

TEST(PlanJob, ReportsInJsonWhatItSummarises) {
  const Planned planned = plan(test::table(3, 2), without_supports());
  const auto report = nlohmann::json::parse(to_json(*planned.summary));
  EXPECT_EQ(report["layers"], 5);
  EXPECT_EQ(report["check"]["passes"], planned.summary->check.passes());
  EXPECT_EQ(report["plan_digest"], to_hex(plan_digest(planned.summary->plan)));
}

}  // namespace
}  // namespace telefab::fab
