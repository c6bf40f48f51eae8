// SPDX-License-Identifier: GPL-3.0-or-later
#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <span>
#include <telefab/fab/drivers/grbl_model.hpp>
#include <telefab/fab/drivers/grbl_stage.hpp>
#include <telefab/fab/drivers/model_transport.hpp>

namespace telefab::fab {
namespace {

using namespace std::chrono_literals;

struct StageBench {
  Result<StageStatus> rest(Nanoseconds most = 100s) {
    const Nanoseconds until = clock.now() + most;
    while (clock.now() < until) {
      auto status = stage->poll();
      if (!status || !status->moving) return status;
      clock.sleep_for(10ms);
    }
    return fail(ErrorCode::Internal, "never at rest");
  }
  void open(double acceleration_mm_per_s2 = 0) {
    model.set_acceleration(acceleration_mm_per_s2);
    auto made = SerialStage::open(
        std::make_unique<ModelLine>(model, clock),
        {.top_mm = 25, .homing_mm_per_s = 20, .acceleration_mm_per_s2 = acceleration_mm_per_s2}, clock);
    ASSERT_TRUE(made) << made.error().what;
    stage = std::move(*made);
  }
  VirtualClock clock;
  MachineLog log;
  GrblModel model{25, clock, &log};
  std::unique_ptr<SerialStage> stage;
};

TEST(GrblStage, HomesUpThenGoesWhereItIsSent) {
  StageBench b;
  b.open();
  ASSERT_TRUE(b.stage->home());
  EXPECT_NEAR(b.rest()->z_mm, 25, 1e-6);
  ASSERT_TRUE(b.stage->move_to(0.1, 3));
  const auto status = b.rest();
  ASSERT_TRUE(status) << status.error().what;
  EXPECT_NEAR(status->z_mm, 0.1, 1e-3);
  EXPECT_NEAR(b.model.gap_mm(), 0.1, 1e-3);
  EXPECT_TRUE(status->homed);
}

TEST(GrblStage, PassesThroughTheFirstLegWithoutRest) {
  StageBench b;
  b.open();
  ASSERT_TRUE(b.stage->home());
  ASSERT_TRUE(b.rest());
  const StageLeg legs[] = {{23, 1}, {15, 4}};
  ASSERT_TRUE(b.stage->move_along(legs));
  const auto status = b.rest();
  ASSERT_TRUE(status) << status.error().what;
  EXPECT_NEAR(status->z_mm, 15, 1e-3);
  const auto moves = b.log.moves();
  ASSERT_EQ(moves.size(), 3u);
  EXPECT_EQ(moves[2].from, moves[1].until);
  EXPECT_EQ(moves[1].until - moves[1].from, 2s);
  EXPECT_EQ(moves[2].until - moves[2].from, 2s);
}

TEST(GrblStage, RefusesAPathOfWhichOneLegCannotBeMade) {
  StageBench b;
  b.open();
  ASSERT_TRUE(b.stage->home());
  ASSERT_TRUE(b.rest());
  const std::uint64_t lines = b.model.lines();
  const StageLeg low[] = {{5, 1}, {-1, 1}}, fast[] = {{5, 1}, {6, 1000}}, many[] = {{5, 1}, {6, 1}, {7, 1}};
  for (const std::span<const StageLeg> legs : {std::span<const StageLeg>{low}, std::span<const StageLeg>{fast},
                                               std::span<const StageLeg>{many}, std::span<const StageLeg>{}})
    EXPECT_EQ(b.stage->move_along(legs).error().code, ErrorCode::InvalidInput);
  EXPECT_EQ(b.stage->tilt(1s).error().code, ErrorCode::InvalidInput);
  EXPECT_EQ(b.model.lines(), lines) << "nothing was sent";
}

TEST(GrblStage, TakesTheTimeOfItsPathOnABoardThatSpeedsUpAndBrakes) {
  for (const double acceleration : {2.0, 10.0, 100.0}) {
    StageBench b;
    b.open(acceleration);
    ASSERT_TRUE(b.stage->home());
    ASSERT_TRUE(b.rest());
    for (const auto& [first, second] : {std::pair{StageLeg{23, 1}, StageLeg{15, 4}},
                                        {StageLeg{20, 4}, StageLeg{19.5, 0.5}},
                                        {StageLeg{19.6, 8}, StageLeg{24.9, 8}}}) {
      const StageLeg legs[] = {first, second};
      const double from_mm = b.model.gap_mm();
      const Nanoseconds from = b.clock.now();
      ASSERT_TRUE(b.stage->move_along(legs));
      ASSERT_TRUE(b.rest());
      const double took_s = double((b.clock.now() - from).count()) * 1e-9;
      const double expected_s = double(path_time(from_mm, legs, acceleration).count()) * 1e-9;
      EXPECT_NEAR(took_s, expected_s, 0.01 * expected_s + 0.05) << acceleration;
    }
  }
}

/// A board that says whatever it is given to say.
class SpeakingLine final : public LineTransport {
 public:
  explicit SpeakingLine(std::vector<std::string> lines) : lines_{std::move(lines)} {}
  Result<void> write(std::string_view, Milliseconds) override { return {}; }
  Result<std::optional<std::string>> read_line(Milliseconds) override {
    if (next_ == lines_.size()) return std::optional<std::string>{};
    return std::optional<std::string>{lines_[next_++]};
  }
  Result<void> reopen() override { return {}; }
  std::string describe() const override { return "lines"; }

 private:
  std::vector<std::string> lines_;
  std::size_t next_ = 0;
};

/// A line whose system keeps what the board said while no program listened.
class LeftBehindLine final : public LineTransport {
 public:
  LeftBehindLine(GrblModel& model, VirtualClock& clock) : model_{model}, clock_{clock} {}
  void deliver() { kept_ += model_.transmit(); }
  Result<void> write(std::string_view bytes, Milliseconds) override {
    deliver();
    return model_.receive(bytes) ? Result<void>{} : fail(ErrorCode::DeviceLost, "hung up");
  }
  Result<std::optional<std::string>> read_line(Milliseconds timeout) override {
    clock_.sleep_for(timeout);
    deliver();
    const std::size_t end = kept_.find("\r\n");
    if (end == std::string::npos) return std::optional<std::string>{};
    std::string line = kept_.substr(0, end);
    kept_.erase(0, end + 2);
    return std::optional<std::string>{std::move(line)};
  }
  Result<void> reopen() override { return {}; }
  std::string describe() const override { return "kept line"; }

 private:
  GrblModel& model_;
  VirtualClock& clock_;
  std::string kept_;
};

// Found by the fuzzer: every later move would have been ordered relative to a place that does not exist.
TEST(GrblStage, IsNotHomedWhereTheBoardNamesAPlaceBeyondAnyAxis) {
  for (const std::string_view place : {"1e30", "-20000.0", "nan", "inf"}) {
    VirtualClock clock;
    auto stage = SerialStage::open(std::make_unique<SpeakingLine>(std::vector<std::string>{
                                       "Grbl 1.1h ['$' for help]", "[G54:0.000,0.000,0.000]", "ok", "ok",
                                       "<Idle|MPos:0.000,0.000," + std::string{place} + "|FS:0,0>"}),
                                   {.top_mm = 25, .homing_mm_per_s = 20}, clock);
    ASSERT_TRUE(stage);
    ASSERT_TRUE((*stage)->home());
    for (int i = 0; i < 5; ++i) {
      const auto status = (*stage)->poll();
      EXPECT_FALSE(status && status->homed) << place;
      clock.sleep_for(10ms);
    }
  }
}

// A program that is killed within the board's start leaves its banner behind.
TEST(GrblStage, TakesNoBannerOfAnEarlierRestartForItsOwn) {
  for (const Nanoseconds killed_after : {0ms, 200ms, 499ms, 500ms, 501ms}) {
    for (const Nanoseconds opened_after : {0ms, 300ms, 2000ms}) {
      SCOPED_TRACE(fmt::format("{} and {} ns", killed_after.count(), opened_after.count()));
      VirtualClock clock;
      MachineLog log;
      GrblModel model{25, clock, &log};
      auto line = std::make_unique<LeftBehindLine>(model, clock);
      ASSERT_TRUE(line->write("\x18", 500ms));
      clock.sleep_for(killed_after);
      line->deliver();
      ASSERT_TRUE(line->write("\x18", 500ms));
      clock.sleep_for(opened_after);
      line->deliver();
      auto stage = SerialStage::open(std::move(line), {.top_mm = 25, .homing_mm_per_s = 20}, clock);
      ASSERT_TRUE(stage) << stage.error().what;
      ASSERT_TRUE((*stage)->home());
      const Nanoseconds until = clock.now() + 20s;
      auto status = (*stage)->poll();
      for (; status && status->moving && clock.now() < until; status = (*stage)->poll()) clock.sleep_for(10ms);
      ASSERT_TRUE(status) << status.error().what;
      EXPECT_TRUE(status->homed);
    }
  }
}

TEST(GrblStage, RefusesABoardThatRestartsAgainAndAgain) {
  VirtualClock clock;
  const auto stage = SerialStage::open(
      std::make_unique<SpeakingLine>(std::vector<std::string>(9, "Grbl 1.1h ['$' for help]")), {.top_mm = 25}, clock);
  ASSERT_FALSE(stage);
  EXPECT_EQ(stage.error().code, ErrorCode::DeviceRefused);
}

TEST(GrblStage, TakesTheTimeOfTheMove) {
  StageBench b;
  b.open();
  ASSERT_TRUE(b.stage->home());
  (void)b.rest();
  const Nanoseconds from = b.clock.now();
  ASSERT_TRUE(b.stage->move_to(10, 3));
  ASSERT_TRUE(b.rest());
  EXPECT_NEAR(double((b.clock.now() - from).count()) * 1e-9, 5, 0.06);
}

TEST(GrblStage, RefusesTargetsAndSpeedsThatAreNotLegal) {
  StageBench b;
  b.open();
  EXPECT_EQ(b.stage->move_to(1, 1).error().code, ErrorCode::Conflict) << "not homed";
  ASSERT_TRUE(b.stage->home());
  (void)b.rest();
  const double nan = std::numeric_limits<double>::quiet_NaN();
  const double inf = std::numeric_limits<double>::infinity();
  for (const double z : {-0.001, 25.001, nan, inf, -inf})
    EXPECT_EQ(b.stage->move_to(z, 1).error().code, ErrorCode::InvalidInput) << z;
  for (const double v : {0.0, -1.0, 10.1, nan, inf})
    EXPECT_EQ(b.stage->move_to(1, v).error().code, ErrorCode::InvalidInput) << v;
  EXPECT_TRUE(b.stage->move_to(1, 1));
  EXPECT_EQ(b.stage->move_to(2, 1).error().code, ErrorCode::Conflict) << "still moving";
}

TEST(GrblStage, MovesNoMoreAfterAnyFaultUntilItIsHomed) {
  for (std::size_t f = 0; f < kStageFaults; ++f) {
    const auto fault = static_cast<StageFault>(f);
    if (fault == StageFault::Garbage) continue;  // harmless
    SCOPED_TRACE(name_of(fault));
    StageBench b;
    b.open();
    ASSERT_TRUE(b.stage->home());
    (void)b.rest();
    b.model.plan_fault(fault, 0);
    ASSERT_TRUE(b.stage->move_to(5, 3) || fault == StageFault::HangUp || fault == StageFault::CableLost);
    const auto failed = b.rest();
    ASSERT_FALSE(failed);
    EXPECT_THAT(failed.error().code,
                testing::AnyOf(ErrorCode::DeviceRefused, ErrorCode::DeviceTimeout, ErrorCode::DeviceLost));
    EXPECT_FALSE(b.stage->move_to(5, 3));
    (void)b.stage->hold();
    ASSERT_TRUE(b.stage->home());
    ASSERT_TRUE(b.rest());
    ASSERT_TRUE(b.stage->move_to(5, 3));
    const auto again = b.rest();
    ASSERT_TRUE(again) << again.error().what;
    EXPECT_NEAR(b.model.gap_mm(), 5, 1e-3);
  }
}

TEST(GrblStage, ReadsThroughGarbage) {
  StageBench b;
  b.open();
  ASSERT_TRUE(b.stage->home());
  (void)b.rest();
  b.model.plan_fault(StageFault::Garbage, 0);
  ASSERT_TRUE(b.stage->move_to(5, 3));
  EXPECT_TRUE(b.rest());
}

TEST(GrblStage, HoldsWithinAMove) {
  StageBench b;
  b.open();
  ASSERT_TRUE(b.stage->home());
  (void)b.rest();
  ASSERT_TRUE(b.stage->move_to(5, 2));
  b.clock.advance(2s);
  ASSERT_TRUE(b.stage->hold());
  const double held = b.model.gap_mm();
  b.clock.advance(20s);
  b.model.tick();
  EXPECT_NEAR(b.model.gap_mm(), held, 1e-9);
  EXPECT_NEAR(held, 21, 0.2);
}

}  // namespace
}  // namespace telefab::fab
