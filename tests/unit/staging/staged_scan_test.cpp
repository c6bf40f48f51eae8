// SPDX-License-Identifier: GPL-3.0-or-later
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <nlohmann/json.hpp>
#include <numbers>
#include <telefab/machine/profile_catalogue.hpp>
#include <telefab/machine/rough_print_time.hpp>
#include <telefab/scan/placing/turn.hpp>
#include <telefab/scan/staging/print_estimate.hpp>
#include <telefab/scan/staging/staged_scan.hpp>

namespace telefab::scan {
namespace {

using nlohmann::json;
using testing::HasSubstr;

/// Points of a ball about (x, y, z) as text; none where z is above `cut`.
std::string ball(double radius, double x, std::size_t count, double cut = 1e9) {
  std::string text;
  for (std::size_t i = 0; i < count; ++i) {
    const double z = 1 - 2 * (static_cast<double>(i) + 0.5) / static_cast<double>(count);
    const double a = std::numbers::pi * (3 - std::sqrt(5.0)) * static_cast<double>(i), r = std::sqrt(1 - z * z);
    if (radius * z > cut) continue;
    text += std::to_string(x + radius * r * std::cos(a)) + ' ' + std::to_string(radius * r * std::sin(a)) + ' ' +
            std::to_string(radius * z) + '\n';
  }
  return text;
}

std::span<const std::byte> bytes_of(const std::string& text) { return std::as_bytes(std::span{text}); }

SliceRequest request_for(double height_mm) {
  static const ProfileCatalogue catalogue = builtin_profiles().value();
  SliceRequest request;
  request.machine = catalogue.compose({"machine-a"})->profile;
  request.placement.height_mm = height_mm;
  return request;
}

TEST(RawScan, TellsPointsBoxAndThatNobodyKnowsTheUnitOfATinyFile) {
  const auto raw = raw_scan(bytes_of(ball(0.5, 0, 3000)), "a.xyz", {});
  ASSERT_TRUE(raw.has_value());
  const json facts = json::parse(raw->facts_json);
  EXPECT_EQ(facts["points"], 3000);
  EXPECT_TRUE(facts["unit_mm"].is_null());
  EXPECT_EQ(facts["unit_is_open"], true);
  EXPECT_EQ(raw->picture.size(), 3000U);
  const auto usual = raw_scan(bytes_of(ball(20, 0, 3000)), "a.xyz", {});
  EXPECT_EQ(json::parse(usual->facts_json)["unit_is_open"], false);
}

TEST(RawScan, RefusesWhatIsNoScan) { EXPECT_FALSE(raw_scan(bytes_of("hello"), "a.ply", {}).has_value()); }

TEST(StagedScan, FindsTheSameOfAScanInMetresAsInMillimetresWhereGapsAreSaidInMillimetres) {
  const auto facts_of = [](double radius, double unit_mm) {
    SliceRequest request = request_for(20);
    request.placement.height_mm.reset();
    request.placement.unit_mm = unit_mm;
    request.most_gap_mm = 3;  // of a hole that is wider
    const auto staged = staged_scan(bytes_of(ball(radius, 0, 6000, 0.8 * radius)), "open.xyz", request, {}, {});
    EXPECT_TRUE(staged.has_value()) << staged.error().what;
    return json::parse(staged->facts_json);
  };
  const json small = facts_of(10, 1), large = facts_of(10, 10);
  // Three millimetres close less of a hole of 60 mm than of one of 6 mm.
  EXPECT_GT(small["completed"], large["completed"]);
  EXPECT_NEAR(small["spacing"].get<double>(), large["spacing"].get<double>(), 1e-3) << "in the unit of the file";
  EXPECT_EQ(facts_of(10, 10)["completed"], facts_of(100, 1)["completed"]);
}

TEST(StagedScan, ShowsThePieceThatIsLeftOut) {
  SliceRequest request = request_for(20);
  request.intake.pick.pieces = 1;
  const std::string file = ball(10, 0, 4000) + ball(3, 40, 1000);
  const auto staged = staged_scan(bytes_of(file), "two.xyz", request, {}, {});
  ASSERT_TRUE(staged.has_value()) << staged.error().what;
  const json facts = json::parse(staged->facts_json);
  EXPECT_EQ(facts["points"], 5000);
  EXPECT_EQ(facts["kept"], 4000);
  ASSERT_EQ(facts["pick"]["pieces"].size(), 2U);
  EXPECT_EQ(facts["pick"]["pieces"][1]["kept"], false);
  EXPECT_GE(staged->picture.size(), 5000U) << "what is left out is shown too";
  EXPECT_EQ(facts["completed"], 0);
}

TEST(StagedScan, ShowsWhatWouldBeCompletedOfABallWithoutItsCap) {
  const auto staged = staged_scan(bytes_of(ball(10, 0, 6000, 7)), "cap.xyz", request_for(20), {}, {});
  ASSERT_TRUE(staged.has_value()) << staged.error().what;
  EXPECT_GT(json::parse(staged->facts_json)["completed"], 100);
}

TEST(StagedScan, EndsSoonWhenItIsStopped) {
  std::stop_source stop;
  stop.request_stop();
  const auto staged = staged_scan(bytes_of(ball(10, 0, 4000)), "a.xyz", request_for(20), {}, stop.get_token());
  ASSERT_FALSE(staged.has_value());
  EXPECT_EQ(staged.error().code, ErrorCode::Cancelled);
}

TEST(PrintEstimate, TellsVolumeSizeLayersAndTimeOfABall) {
  const SliceRequest request = request_for(20);
  const auto staged = staged_scan(bytes_of(ball(10, 0, 6000)), "a.xyz", request, {}, {});
  const auto estimate = estimate_print(*staged, request, {});
  ASSERT_TRUE(estimate.has_value()) << estimate.error().what;
  const double ball_mm3 = 4.0 / 3 * std::numbers::pi * 1000;
  EXPECT_NEAR(estimate->figures.part_mm3, ball_mm3, 0.05 * ball_mm3);
  EXPECT_NEAR(estimate->figures.size_mm.z(), 20, 0.1);
  EXPECT_GE(estimate->figures.layers * estimate->layer_mm, 20);
  EXPECT_GT(estimate->figures.anchors, 0U);
  EXPECT_NEAR(estimate->resin_ml, (estimate->figures.part_mm3 + estimate->figures.support_mm3) / 1000, 1e-9);
  EXPECT_EQ(estimate->print_time, rough_print_time(request.machine, estimate->figures.layers, estimate->layer_mm));
}

TEST(PrintEstimate, TellsWhatTheResinCostsWhereItsPriceIsStated) {
  PrintEstimate estimate;
  estimate.resin_ml = 40;
  EXPECT_TRUE(json::parse(to_json(estimate))["cost"].is_null());
  estimate.price = ResinPrice{45, "EUR"};
  EXPECT_EQ(json::parse(to_json(estimate))["cost"], json({{"amount", 1.8}, {"currency", "EUR"}, {"per_litre", 45}}));
}

TEST(PrintEstimate, IsOfTheTurnThatIsAskedFor) {
  SliceRequest request = request_for(20);
  std::string file;
  for (const double x : {0.0, 15.0, 30.0, 45.0}) file += ball(10, x, 2000);
  const auto staged = staged_scan(bytes_of(file), "row.xyz", request, {}, {});
  ASSERT_TRUE(staged.has_value()) << staged.error().what;
  request.placement = {};
  const auto lying = estimate_print(*staged, request, {});
  request.placement.turn = turn_from_rotate("0,90,0").value();
  const auto upright = estimate_print(*staged, request, {});
  ASSERT_TRUE(lying && upright);
  EXPECT_NEAR(lying->figures.size_mm.z(), 20, 0.3);
  EXPECT_NEAR(upright->figures.size_mm.z(), 65, 0.5);
  EXPECT_NEAR(lying->figures.part_mm3, upright->figures.part_mm3, 0.02 * lying->figures.part_mm3);
}

TEST(PrintEstimate, JudgesAMissingBaseAsThePartStandsAndNotAsItLiesInItsFile) {
  // Half a ball without its flat side, which looks up in the file.
  SliceRequest request = request_for(10);
  request.flat_base = true;
  const auto staged = staged_scan(bytes_of(ball(10, 0, 8000, 0)), "half.xyz", request, {}, {});
  ASSERT_TRUE(staged.has_value()) << staged.error().what;
  const auto surface = [&](const char* rotate, std::optional<MirrorAxis> mirror) -> std::optional<ForeseenItem> {
    request.placement.turn = turn_from_rotate(rotate).value();
    request.placement.mirror = mirror;
    const auto estimate = estimate_print(*staged, request, {});
    EXPECT_TRUE(estimate.has_value()) << estimate.error().what;
    if (estimate->items.front().name != "surface") return std::nullopt;
    return estimate->items.front();
  };
  const auto as_in_file = surface("0,0,0", {});
  ASSERT_TRUE(as_in_file.has_value());
  EXPECT_EQ(as_in_file->verdict, Verdict::Held);
  EXPECT_THAT(as_in_file->text, HasSubstr("facing up"));
  const auto missing_cm2 = [](const std::string& text) { return std::stod(text.substr(text.find("about ") + 6)); };
  EXPECT_NEAR(missing_cm2(as_in_file->text), std::numbers::pi, 0.15 * std::numbers::pi) << "a disc of 10 mm";
  EXPECT_FALSE(surface("180,0,0", {}).has_value()) << "then the missing side is the base";
  EXPECT_FALSE(surface("0,0,0", MirrorAxis::Z).has_value()) << "and the other hand of it lies on its base too";
  const auto on_its_side = surface("90,0,0", {});
  ASSERT_TRUE(on_its_side.has_value());
  EXPECT_THAT(on_its_side->text, HasSubstr("facing towards -y"));
  request.placement.height_mm = 20;
  EXPECT_NEAR(missing_cm2(surface("0,0,0", {})->text), 4 * missing_cm2(as_in_file->text), 0.1)
      << "of the print, whatever size it was looked at in";
}

TEST(PrintEstimate, RefusesAPartThatDoesNotFitAndOneWhoseUnitNobodyStates) {
  SliceRequest request = request_for(20);
  const auto staged = staged_scan(bytes_of(ball(0.5, 0, 3000)), "a.xyz", request, {}, {});
  request.placement.height_mm = 5000;
  EXPECT_THAT(estimate_print(*staged, request, {}).error().what, HasSubstr("larger than machine-a"));
  request.placement.height_mm.reset();
  const auto unit = estimate_print(*staged, request, {});
  ASSERT_FALSE(unit.has_value());
  EXPECT_EQ(unit.error().code, ErrorCode::InvalidInput);
}

TEST(RoughPrintTime, CountsEveryLayerAndTheBottomOnesLonger) {
  const MachineProfile machine = request_for(20).machine;
  const auto few = rough_print_time(machine, 10, 0.1), more = rough_print_time(machine, 110, 0.1);
  const auto most = rough_print_time(machine, 210, 0.1);
  EXPECT_GT(machine.layers.bottom_exposure_s, machine.layers.exposure_s);
  // Each hundred layers more take the same, less the way up that the stage is spared.
  EXPECT_NEAR((more - few).count(), (most - more).count(), 1e-6);
  EXPECT_GT((more - few).count(), 100 * machine.layers.exposure_s);
}

}  // namespace
}  // namespace telefab::scan
