// SPDX-License-Identifier: GPL-3.0-or-later
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <telefab/base/file.hpp>
#include <telefab/fab/planning/plan_folder.hpp>
#include <telefab/fab/planning/plan_room.hpp>
#include <telefab/test/block_stack.hpp>
#include <telefab/test/overlooked.hpp>
#include <telefab/test/scratch_folder.hpp>

namespace telefab::fab {
namespace {

namespace fs = std::filesystem;
using testing::HasSubstr;

class PlanFolderTest : public testing::Test {
 protected:
  Result<PlanSummary> write(const fs::path& folder, std::uint32_t layers = 4, std::stop_token stop = {}) {
    return write_plan_folder(folder, test::table(layers - 1, 1), test::small_machine(), {}, clock, {}, stop);
  }
  test::ScratchFolder scratch;
  fs::path root = scratch.path();
  VirtualClock clock;
};

TEST_F(PlanFolderTest, HoldsEverythingAPrintNeedsAndNothingElseIsLeft) {
  const auto summary = write(root / "plan");
  ASSERT_TRUE(summary) << summary.error().what;
  for (const char* name : {"plan.json", "supports.json", "report.json", "preview.png", "view.png", "masks/00000.png"})
    EXPECT_TRUE(fs::exists(root / "plan" / name)) << name;
  EXPECT_EQ(std::distance(fs::directory_iterator{root}, {}), 1);
  const auto job = PlannedJob::open(root / "plan");
  ASSERT_TRUE(job) << job.error().what;
  EXPECT_EQ((*job)->plan(), summary->plan);
  for (const PlannedLayer& layer : (*job)->plan().layers) EXPECT_TRUE((*job)->mask(layer.index));
}

TEST_F(PlanFolderTest, ReplacesAnOlderPlanWholly) {
  ASSERT_TRUE(write(root / "plan", 9));
  const auto summary = write(root / "plan/", 4);
  ASSERT_TRUE(summary) << summary.error().what;
  EXPECT_EQ(static_cast<std::size_t>(std::distance(fs::directory_iterator{root / "plan/masks"}, {})),
            summary->plan.layers.size());
  EXPECT_EQ(std::distance(fs::directory_iterator{root}, {}), 1);
}

TEST_F(PlanFolderTest, HoldsTheLastLayersAloneWhereSupportsWereAddedForWhatFloated) {
  const test::Overlooked part{2, 11};
  const auto summary = write_plan_folder(root / "plan", part.stack, test::small_machine(), part.options, clock, {}, {});
  ASSERT_TRUE(summary) << summary.error().what;
  ASSERT_EQ(summary->repairs, 1U);
  const auto job = PlannedJob::open(root / "plan");
  ASSERT_TRUE(job) << job.error().what;
  for (const PlannedLayer& layer : (*job)->plan().layers) EXPECT_TRUE((*job)->mask(layer.index));
  const auto supports = (*job)->supports();
  ASSERT_TRUE(supports) << supports.error().what;
  EXPECT_EQ(supports->size(), summary->plan.layers.size());
  EXPECT_TRUE(std::ranges::any_of(*supports, [](const auto& rings) { return !rings.empty(); }));
}

TEST_F(PlanFolderTest, TakesNoMoreRoomThanWasComputedForItBefore) {
  const LayerStack stack = test::table(9, 1);
  ASSERT_TRUE(write(root / "plan", 10));
  std::uint64_t bytes = 0;
  for (const auto& file : fs::recursive_directory_iterator{root / "plan"})
    if (file.is_regular_file()) bytes += (file.file_size() + 4095) / 4096 * 4096;
  const std::uint64_t chunks = fs::file_size(root / "plan" / "part.tfc");
  EXPECT_LE(bytes, plan_room_bytes(stack, chunks));
  EXPECT_LE(plan_room_bytes(stack, chunks), offer_room_bytes(stack.header()));
}

// What a plan takes beside its pictures and reports grows with its layers; so must what is computed for it.
TEST(PlanRoom, GrowsWithLayersContoursAndChunks) {
  const LayerStack low = test::table(9, 1);
  const LayerStack high = test::table(90, 1);
  const std::uint64_t layers = high.header().layer_count - low.header().layer_count;
  EXPECT_GT(plan_room_bytes(high, 0) - plan_room_bytes(low, 0), layers * 8192);
  EXPECT_EQ(plan_room_bytes(low, 1000) - plan_room_bytes(low, 0), 8000U);
  EXPECT_GT(offer_room_bytes(high.header()) - offer_room_bytes(low.header()), layers * 8192);
}

TEST_F(PlanFolderTest, RefusesAFolderThatHoldsSomethingElse) {
  fs::create_directories(root / "photos");
  ASSERT_TRUE(write_new_file(root / "photos/cat.png", {}));
  const auto summary = write(root / "photos");
  ASSERT_FALSE(summary);
  EXPECT_EQ(summary.error().code, ErrorCode::Conflict);
  EXPECT_TRUE(fs::exists(root / "photos/cat.png"));
}

TEST_F(PlanFolderTest, LeavesTheOlderPlanWhereTheNewOneIsCancelled) {
  ASSERT_TRUE(write(root / "plan"));
  std::stop_source stop;
  stop.request_stop();
  EXPECT_EQ(write(root / "plan", 9, stop.get_token()).error().code, ErrorCode::Cancelled);
  EXPECT_TRUE(PlannedJob::open(root / "plan"));
  EXPECT_EQ(std::distance(fs::directory_iterator{root}, {}), 1);
}

TEST_F(PlanFolderTest, SaysWhichMaskIsMissingOrWasChanged) {
  ASSERT_TRUE(write(root / "plan"));
  const auto job = PlannedJob::open(root / "plan").value();
  const auto other = read_file(job->mask_path(LayerIndex{0}), 1U << 20U).value();
  const LayerIndex last{static_cast<std::uint32_t>(job->plan().layers.size() - 1)};
  ASSERT_TRUE(write_file_atomically(job->mask_path(last), other));
  const auto changed = job->mask(last);
  ASSERT_FALSE(changed);
  EXPECT_EQ(changed.error().code, ErrorCode::NotTrusted);
  fs::remove(job->mask_path(last));
  EXPECT_THAT(PlannedJob::open(root / "plan").error().what, HasSubstr(job->mask_path(last).filename().string()));
  EXPECT_EQ(job->mask(LayerIndex{9999}).error().code, ErrorCode::NotFound);
}

TEST_F(PlanFolderTest, RefusesAPlanThatIsNoPlan) {
  EXPECT_EQ(PlannedJob::open(root / "none").error().code, ErrorCode::NotFound);
  fs::create_directories(root / "plan");
  ASSERT_TRUE(write_file_atomically(root / "plan/plan.json", "{\"layers\":"));
  EXPECT_EQ(PlannedJob::open(root / "plan").error().code, ErrorCode::InvalidInput);
}

}  // namespace
}  // namespace telefab::fab
