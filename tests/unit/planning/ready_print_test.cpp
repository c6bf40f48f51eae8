// SPDX-License-Identifier: GPL-3.0-or-later
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <telefab/base/clock.hpp>
#include <telefab/fab/planning/plan_job.hpp>
#include <telefab/fab/planning/preflight.hpp>
#include <telefab/test/block_stack.hpp>

// Prints whose masks another program made.
namespace telefab::fab {
namespace {

using namespace std::chrono_literals;
using testing::HasSubstr;

/// A box of lit pixels.
struct Box {
  std::uint32_t x0, y0, x1, y1;
  std::uint8_t grey = 255;
};

class BoxMasks final : public MaskSource {
 public:
  BoxMasks(PixelSize size, std::vector<std::vector<Box>> layers) : size_{size}, layers_{std::move(layers)} {}
  [[nodiscard]] Result<Mask> mask(LayerIndex layer) override {
    Mask mask{size_, std::vector<std::uint8_t>(std::size_t{size_.width_px} * size_.height_px)};
    for (const Box& box : layers_.at(layer.count()))
      for (std::uint32_t y = box.y0; y < box.y1; ++y)
        std::fill_n(mask.rows.begin() + static_cast<std::ptrdiff_t>(std::size_t{y} * size_.width_px + box.x0),
                    box.x1 - box.x0, box.grey);
    return mask;
  }

 private:
  PixelSize size_;
  std::vector<std::vector<Box>> layers_;
};

std::shared_ptr<ReadyPrint> print_of(const MachineProfile& machine, std::vector<std::vector<Box>> layers) {
  auto print = std::make_shared<ReadyPrint>();
  print->thickness_mm = 0.05;  // not the machine's
  print->origin = "made by a test";
  for (std::size_t i = 0; i < layers.size(); ++i) {
    ReadyPrint::Layer layer;
    layer.z_mm = 0.04 + 0.05 * static_cast<double>(i);
    layer.exposure = i == 0 ? 20s : 3s;
    layer.motion.lift_mm = 4 + static_cast<double>(i);
    layer.light_share = 0.5;
    print->layers.push_back(layer);
  }
  print->masks = std::make_shared<BoxMasks>(machine.mask_size(), std::move(layers));
  return print;
}

/// A foot and a smaller block on it.
std::vector<std::vector<Box>> steps() {
  return {{{20, 20, 60, 60}}, {{20, 20, 60, 60}}, {{30, 30, 50, 50}, {50, 30, 51, 50, 100}}, {{30, 30, 50, 50}}};
}

PlanOptions as_it_is(std::shared_ptr<const ReadyPrint> print) {
  PlanOptions options;
  options.ready = std::move(print);
  options.masks = MaskMethod::Cover;
  options.supports.mode = SupportOptions::Mode::None;
  return options;
}

struct Planned {
  Result<PlanSummary> summary = fail(ErrorCode::Internal, "not planned");
  Preflight preflight;
};

Planned planned(const std::vector<std::vector<Box>>& layers, const MachineProfile& machine = test::small_machine()) {
  const auto print = print_of(machine, layers);
  const auto stack = outlines_of(*print, machine, "boxes.sl1", {}, {});
  EXPECT_TRUE(stack) << stack.error().what;
  if (!stack) return {};
  const VirtualClock clock;
  Planned out;
  out.summary =
      plan_job(*stack, machine, as_it_is(print), [](const PlannedImage&) -> Result<void> { return {}; }, clock, {}, {});
  EXPECT_TRUE(out.summary) << out.summary.error().what;
  if (out.summary) out.preflight = preflight_of(*stack, machine, *out.summary);
  return out;
}

TEST(ReadyPrint, IsPlannedWithItsOwnPixelsTimesMotionAndHeights) {
  const MachineProfile machine = test::small_machine();
  const auto made = planned(steps());
  const PrintPlan& plan = made.summary->plan;
  ASSERT_EQ(plan.layers.size(), 4U);
  const auto print = print_of(machine, steps());
  for (const PlannedLayer& layer : plan.layers) {
    const auto mask = print->masks->mask(layer.index);
    EXPECT_EQ(layer.mask, digest_of(std::as_bytes(std::span{mask->rows})));
    const ReadyPrint::Layer& own = print->layers[layer.index.count()];
    EXPECT_EQ(layer.exposure, own.exposure);
    EXPECT_EQ(layer.motion, own.motion);
    EXPECT_EQ(layer.light_share, own.light_share);
    EXPECT_EQ(layer.z_mm, own.z_mm);
  }
  EXPECT_EQ(made.summary->anchors.size(), 0U);
  EXPECT_EQ(made.summary->elevation_layers, 0U);
  EXPECT_TRUE(made.summary->check.passes());
}

TEST(ReadyPrint, IsRefusedWithPixelsThatNoLightWouldReachAndTakenWithABlackLayerWithoutLight) {
  const MachineProfile machine = test::small_machine();
  const auto error_of = [&](std::vector<std::vector<Box>> layers) {
    auto print = print_of(machine, std::move(layers));
    print->layers[2].exposure = 0s;
    const auto stack = outlines_of(*print, machine, "boxes.sl1", {}, {});
    EXPECT_TRUE(stack) << stack.error().what;
    const VirtualClock clock;
    const auto summary = plan_job(*stack, machine, as_it_is(print),
                                  [](const PlannedImage&) -> Result<void> { return {}; }, clock, {}, {});
    return summary ? std::string{} : summary.error().what;
  };
  EXPECT_THAT(error_of(steps()), HasSubstr("layer 2 has pixels to light and an exposure of 0 s"));
  auto black = steps();
  black[2].clear();
  EXPECT_EQ(error_of(black), "");
}

TEST(ReadyPrint, IsPassedWhereNothingFloatsAndSaysWhoMadeIt) {
  const auto made = planned(steps());
  const auto item = std::ranges::find(made.preflight.items, "file", &PreflightItem::name);
  ASSERT_NE(item, made.preflight.items.end());
  EXPECT_EQ(item->text, "made by a test");
  const auto islands = std::ranges::find(made.preflight.items, "islands", &PreflightItem::name);
  EXPECT_EQ(islands->verdict, PreflightItem::Verdict::Passed);
}

TEST(ReadyPrint, IsHeldWhereSomethingFloatsWhateverTheProfileKnowsOfItsResin) {
  auto layers = steps();
  layers[2].push_back({80, 80, 90, 90});
  layers[3].push_back({80, 80, 90, 90});
  for (const double critical : {10.0, 1000.0}) {
    MachineProfile machine = test::small_machine();
    machine.resin.critical_dose_mj_per_cm2 = critical;  // by the larger one nothing would cure at all
    const auto made = planned(layers, machine);
    EXPECT_EQ(made.summary->check.count(Finding::Kind::Island), 1U) << critical;
    EXPECT_TRUE(made.preflight.holds());
    EXPECT_THAT(made.preflight.why_held(), HasSubstr("islands"));
  }
}

TEST(ReadyPrint, IsJudgedByThePullOfTheFilm) {
  // 120 x 120 pixels on a post of two.
  const std::vector<std::vector<Box>> layers{
      {{40, 40, 60, 60}}, {{50, 50, 52, 52}}, {{50, 50, 52, 52}}, {{10, 10, 130, 130}}};
  const auto made = planned(layers);
  ASSERT_NE(made.summary->carry.worst(), nullptr);
  EXPECT_GT(made.summary->carry.worst()->demand, 3000);
  EXPECT_THAT(made.preflight.why_held(), HasSubstr("carry"));
}

TEST(ReadyPrint, IsShownByTheOutlinesOfItsSolidPixels) {
  const MachineProfile machine = test::small_machine();
  const double p = machine.projection.pixel_pitch_mm;
  const auto stack = outlines_of(*print_of(machine, steps()), machine, "boxes.sl1", {}, {});
  ASSERT_TRUE(stack) << stack.error().what;
  EXPECT_EQ(stack->header().scan_name, "boxes.sl1");
  EXPECT_EQ(stack->header().layer_thickness_mm, 0.05);
  double area = 0;
  for (const Contour& ring : stack->layers()[2].contours) area += ring.signed_area_mm2();
  EXPECT_NEAR(area, 20 * 20 * p * p, 1e-6) << "a rim of grey 100 is not solid";
  EXPECT_EQ(stack->layers()[2].certificate.method, LayerCertificate::Method::Imported);
}

TEST(ReadyPrint, KeepsSinglePixelsInItsOutlines) {
  const MachineProfile machine = test::small_machine();
  const double p = machine.projection.pixel_pitch_mm;
  const auto stack = outlines_of(*print_of(machine, {{{7, 9, 8, 10}}}), machine, "dot", {}, {});
  ASSERT_TRUE(stack);
  ASSERT_EQ(stack->layers()[0].contours.size(), 1U);
  EXPECT_NEAR(stack->layers()[0].contours[0].signed_area_mm2(), p * p, 1e-9);
}

TEST(ReadyPrint, RefusesMasksOfAnotherSizeAndMasksWithoutLight) {
  MachineProfile machine = test::small_machine();
  const auto print = print_of(machine, steps());
  machine.platform.width_mm *= 2;
  EXPECT_THAT(outlines_of(*print, machine, "x", {}, {}).error().what, HasSubstr("layer 0 has"));
  const auto dark = print_of(test::small_machine(), {{}, {}});
  EXPECT_THAT(outlines_of(*dark, test::small_machine(), "x", {}, {}).error().what, HasSubstr("none of its 2 masks"));
}

TEST(ReadyPrint, TakesNeitherSupportsNorSolvedMasks) {
  PlanOptions options = as_it_is(print_of(test::small_machine(), steps()));
  EXPECT_TRUE(options.validate());
  options.supports.mode = SupportOptions::Mode::Auto;
  EXPECT_EQ(options.validate().error().code, ErrorCode::InvalidInput);
  options = as_it_is(options.ready);
  options.masks = MaskMethod::BlendStack;
  EXPECT_EQ(options.validate().error().code, ErrorCode::InvalidInput);
}

TEST(ReadyPrint, IsPlannedAlikeOnAnyNumberOfThreads) {
  const MachineProfile machine = test::small_machine();
  const auto print = print_of(machine, steps());
  const auto stack = outlines_of(*print, machine, "boxes", {}, {});
  const VirtualClock clock;
  std::vector<std::string> plans;
  for (const int threads : {1, 8}) {
    PlanOptions options = as_it_is(print);
    options.threads = threads;
    const auto summary =
        plan_job(*stack, machine, options, [](const PlannedImage&) -> Result<void> { return {}; }, clock, {}, {});
    ASSERT_TRUE(summary);
    plans.push_back(to_json(summary->plan));
  }
  EXPECT_EQ(plans[0], plans[1]);
}

}  // namespace
}  // namespace telefab::fab
