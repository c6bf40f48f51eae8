// SPDX-License-Identifier: GPL-3.0-or-later
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <telefab/fab/planning/cured_runs.hpp>
#include <telefab/fab/planning/plan_job.hpp>
#include <telefab/test/block_stack.hpp>
#include <telefab/test/overlooked.hpp>

namespace telefab::fab {
namespace {

using testing::HasSubstr;
using namespace std::chrono_literals;

class MaskList final : public MaskSource {
 public:
  explicit MaskList(std::vector<Mask> masks) : masks_{std::move(masks)} {}
  [[nodiscard]] Result<Mask> mask(LayerIndex layer) override { return masks_.at(layer.count()); }

 private:
  std::vector<Mask> masks_;
};

struct Planned {
  PlanSummary summary;
  std::unique_ptr<MaskList> masks;
};

Planned planned(const LayerStack& stack, const PlanOptions& options) {
  const VirtualClock clock;
  std::vector<Mask> masks;
  const auto keep = [&](const PlannedImage& layer_image) -> Result<void> {
    if (layer_image.index.count() == 0) masks.clear();
    auto image = decode_png(layer_image.png, 10'000'000);
    if (!image) return tl::unexpected{image.error()};
    masks.push_back({{image->width_px, image->height_px}, std::move(image->pixels)});
    return {};
  };
  auto summary = plan_job(stack, test::small_machine(), options, keep, clock, {}, {});
  EXPECT_TRUE(summary) << summary.error().what;
  return {std::move(*summary), std::make_unique<MaskList>(std::move(masks))};
}

SupportReport checked(const Planned& job, MaskCheckOptions options = {}) {
  const auto report = check_masks(job.summary.plan, *job.masks, test::small_machine(), options, {}, {});
  EXPECT_TRUE(report) << report.error().what;
  return report.value_or(SupportReport{});
}

/// A block with a piece of `size_mm` that floats beside it for some layers.
LayerStack with_a_floating_piece(double size_mm, std::size_t layers) {
  std::vector<std::vector<Contour>> rings(20, {test::rectangle(5, 5, 15, 15)});
  for (std::size_t i = 6; i < 6 + layers; ++i) rings[i].push_back(test::rectangle(20, 20, 20 + size_mm, 20 + size_mm));
  return test::stack_of(rings);
}

/// A tub that is closed by a lid: its hollow is a trap for resin.
LayerStack closed_tub() {
  std::vector<Contour> wall{test::rectangle(5, 5, 15, 15)};
  const Contour inside = test::rectangle(7, 7, 13, 13);
  wall.push_back(Contour::from_vertices({inside.vertices().rbegin(), inside.vertices().rend()}).value());
  std::vector<std::vector<Contour>> rings(6, {test::rectangle(5, 5, 15, 15)});
  rings.resize(40, wall);
  rings.resize(48, {test::rectangle(5, 5, 15, 15)});
  return test::stack_of(rings);
}

struct GoldenPart {
  std::string name;
  LayerStack stack;
};
std::vector<GoldenPart> golden_parts() {
  std::vector<GoldenPart> parts;
  parts.push_back({"table", test::table(20, 12)});
  parts.push_back({"large piece afloat", with_a_floating_piece(2, 10)});
  parts.push_back({"thin piece afloat", with_a_floating_piece(0.4, 3)});
  parts.push_back({"closed tub", closed_tub()});
  return parts;
}

/// Every way the planner can be told to make masks.
std::vector<PlanOptions> golden_options() {
  std::vector<PlanOptions> all;
  for (const auto mode : {SupportOptions::Mode::None, SupportOptions::Mode::Auto})
    for (const MaskMethod method : kMaskMethods)
      for (const double depth : {0.0, 1.5, 4.0}) {
        PlanOptions options;
        options.supports.mode = mode;
        options.masks = method;
        options.cure_depth_layers = depth;
        all.push_back(options);
      }
  for (const auto kind : {InnerPattern::Kind::Checker, InnerPattern::Kind::ShellCore}) {
    PlanOptions options;
    options.pattern.kind = kind;
    all.push_back(options);
  }
  PlanOptions plain;
  plain.compensate_undersides = false;
  plain.supports.mode = SupportOptions::Mode::None;
  all.push_back(plain);
  return all;
}

TEST(MaskCheck, AgreesWithThePlannerOnEveryGoldenPlan) {
  int sound = 0, unsound = 0;
  for (const GoldenPart& part : golden_parts())
    for (const PlanOptions& options : golden_options()) {
      const Planned job = planned(part.stack, options);
      const SupportReport report = checked(job);
      const std::string which = part.name + ", " + std::string{name_of(options.masks)} + ", cure depth " +
                                std::to_string(options.cure_depth_layers) + ", " +
                                std::string{name_of(options.pattern.kind)};
      EXPECT_EQ(report.passes(), job.summary.check.passes()) << which;
      for (const auto kind : {Finding::Kind::Island, Finding::Kind::SuctionCup, Finding::Kind::ResinTrap})
        EXPECT_EQ(report.count(kind), job.summary.check.count(kind)) << which << ": " << name_of(kind);
      ++(report.passes() ? sound : unsound);
    }
  EXPECT_GT(sound, 20);
  EXPECT_GT(unsound, 8);
}

TEST(MaskCheck, JudgesByThePlansExposuresAndNotByTheProfilesOfToday) {
  // Greys that only a longer exposure than the profile's cures: judged by the profile, the block would be missing.
  PlanOptions options;
  options.masks = MaskMethod::Cover;
  const Planned job = planned(test::table(10, 1), options);
  MachineProfile later = test::small_machine();
  later.layers.exposure_s /= 16;
  later.layers.bottom_exposure_s /= 16;
  const auto report = check_masks(job.summary.plan, *job.masks, later, {}, {}, {});
  ASSERT_TRUE(report) << report.error().what;
  EXPECT_EQ(report->count(Finding::Kind::Island), job.summary.check.count(Finding::Kind::Island));
}

TEST(MaskCheck, AsksHowMasksWereMadeWhereThePlanIsOlderThanItsField) {
  Planned job = planned(test::table(20, 4), {});
  job.summary.plan.masks.reset();
  const auto report = check_masks(job.summary.plan, *job.masks, test::small_machine(), {}, {}, {});
  ASSERT_FALSE(report);
  EXPECT_EQ(report.error().code, ErrorCode::InvalidInput);
  EXPECT_THAT(report.error().what, HasSubstr("--masks"));
  EXPECT_TRUE(checked(job, {.grey = {}, .masks = MaskMethod::BlendStack}).passes());
}

TEST(MaskCheck, RefusesToJudgeAPlanByAnotherMethodThanItsOwn) {
  const Planned job = planned(test::table(3, 1), {});
  const auto report = check_masks(job.summary.plan, *job.masks, test::small_machine(),
                                  {.grey = {}, .masks = MaskMethod::Cover}, {}, {});
  ASSERT_FALSE(report);
  EXPECT_EQ(report.error().code, ErrorCode::InvalidInput);
}

/// Two layers of which only the upper one is lit, for `upper`.
Result<std::vector<CuredRuns>> lit_from_above(std::chrono::microseconds upper) {
  const MachineProfile machine = test::small_machine();
  const PixelSize size = machine.mask_size();
  const std::size_t pixels = std::size_t{size.width_px} * size.height_px;
  Mask dark{size, std::vector<std::uint8_t>(pixels, 0)}, lit = dark;
  for (std::uint32_t y = 100; y < 200; ++y)
    for (std::uint32_t x = 100; x < 200; ++x) lit.rows[std::size_t{y} * size.width_px + x] = 255;
  MaskList masks{{dark, lit}};
  PrintPlan plan;
  plan.mask_size = size;
  plan.layers = {{LayerIndex{0}, 0.1, 0s, {}}, {LayerIndex{1}, 0.2, upper, {}}};
  return cured_runs(plan, masks, machine, {}, {});
}

TEST(CuredRuns, ADarkLayerIsSolidWhereLaterLightShinesThrough) {
  const auto runs = lit_from_above(8s);  // cures 0.55 mm deep: through both layers
  ASSERT_TRUE(runs) << runs.error().what;
  EXPECT_TRUE((*runs)[0].solid.contains(150, 150));
  EXPECT_TRUE((*runs)[1].solid.contains(150, 150));
  EXPECT_FALSE((*runs)[0].solid.contains(50, 50));
  EXPECT_EQ((*runs)[0].light.lit.count(), 0U);
  EXPECT_TRUE((*runs)[1].light.lit.contains(150, 150));
}

TEST(CuredRuns, ADarkLayerStaysLiquidWhereLaterLightDoesNotReach) {
  const auto runs = lit_from_above(620ms);  // cures 0.04 mm deep: not to the middle of its own layer
  ASSERT_TRUE(runs) << runs.error().what;
  EXPECT_EQ((*runs)[0].solid.count(), 0U);
  EXPECT_EQ((*runs)[1].solid.count(), 0U);
  EXPECT_TRUE((*runs)[1].light.joined.contains(150, 150));
}

TEST(CuredRuns, StopsWhenAsked) {
  const Planned job = planned(test::table(3, 1), {});
  std::stop_source stopped;
  stopped.request_stop();
  const auto runs = cured_runs(job.summary.plan, *job.masks, test::small_machine(), {}, stopped.get_token());
  ASSERT_FALSE(runs);
  EXPECT_EQ(runs.error().code, ErrorCode::Cancelled);
}

}  // namespace
}  // namespace telefab::fab
