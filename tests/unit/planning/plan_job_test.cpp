#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <nlohmann/json.hpp>
#include <telefab/fab/mask/raster.hpp>
#include <telefab/fab/planning/plan_job.hpp>
#include <telefab/test/block_stack.hpp>

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
  const auto keep = [&](const PlannedSheet& sheet) -> Result<void> {
    EXPECT_EQ(sheet.index.count(), planned.pngs.size());
    planned.pngs.emplace_back(sheet.png.begin(), sheet.png.end());
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
  const Planned planned = plan(stack, without_supports());
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
  EXPECT_GT(planned.summary->anchors, 2U);
  EXPECT_TRUE(planned.summary->check.passes());
  EXPECT_GT(planned.summary->cured_mm3, planned.summary->figures.part_mm3);
}

TEST(PlanJob, SeesWhatFloatsWhereNothingHoldsIt) {
  std::vector<std::vector<Contour>> rings(10, {test::rectangle(5, 5, 15, 15)});
  for (std::size_t i = 5; i < 10; ++i) rings[i].push_back(test::rectangle(20, 20, 22, 22));
  const Planned planned = plan(test::stack_of(rings), without_supports());
  ASSERT_TRUE(planned.summary);
  EXPECT_FALSE(planned.summary->check.passes());
  EXPECT_EQ(planned.summary->check.count(Finding::Kind::Island), 1U);
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
  const auto full = [](const PlannedSheet&) -> Result<void> {
    return fail(ErrorCode::StorageFailed, "the disk is full");
  };
  EXPECT_EQ(plan_job(test::table(3, 3), test::small_machine(), {}, full, clock, {}, {}).error().code,
            ErrorCode::StorageFailed);
}

TEST(PlanJob, CountsThePrintsTimeFromExposuresAndMotion) {
  MachineProfile machine = test::small_machine();
  machine.motion = {6, 2, 3, 0.5};
  const Planned planned = plan(test::stack_of(std::vector<std::vector<Contour>>(4, {test::rectangle(5, 5, 15, 15)})),
                               without_supports(), machine);
  ASSERT_TRUE(planned.summary);
  EXPECT_DOUBLE_EQ(planned.summary->exposure_s, 3 * 8.0 + 2.0);
  EXPECT_DOUBLE_EQ(planned.summary->print_s, 26.0 + 4 * (3 + 2 + 0.5));
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
