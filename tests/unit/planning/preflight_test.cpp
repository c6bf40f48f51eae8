// SPDX-License-Identifier: GPL-3.0-or-later
#include <fmt/format.h>
#include <gmock/gmock.h>

#include <cmath>

#include <nlohmann/json.hpp>
#include <telefab/fab/planning/preflight.hpp>
#include <telefab/test/block_stack.hpp>

namespace telefab::fab {
namespace {

using testing::HasSubstr;
using Verdict = PreflightItem::Verdict;

class PreflightTest : public testing::Test {
 protected:
  [[nodiscard]] PreflightItem item(std::string_view name) const {
    const Preflight preflight = preflight_of(stack, machine, summary);
    for (const PreflightItem& each : preflight.items)
      if (each.name == name) return each;
    ADD_FAILURE() << "no item " << name;
    return {};
  }
  LayerStack stack = test::table(3, 1);
  MachineProfile machine = test::small_machine();
  PlanSummary summary = plan();
  [[nodiscard]] PlanSummary plan() const {
    const VirtualClock clock;
    auto planned = plan_job(stack, machine, {}, [](const PlannedImage&) { return Result<void>{}; }, clock, {}, {});
    EXPECT_TRUE(planned) << planned.error().what;
    return std::move(*planned);
  }
};

TEST_F(PreflightTest, OfAPartThatStandsHoldsNothing) {
  const Preflight preflight = preflight_of(stack, machine, summary);
  EXPECT_FALSE(preflight.holds());
  EXPECT_EQ(preflight.why_held(), "");
  EXPECT_EQ(item("islands").verdict, Verdict::Passed);
}

TEST_F(PreflightTest, NamesWhatOfTheProfileNobodyHasMeasuredAndHoldsNothingForIt) {
  for (const PreflightItem& each : preflight_of(stack, machine, summary).items) EXPECT_NE(each.name, "profile");
  machine.assumed = {"projection.irradiance_mw_per_cm2", "resin.penetration_mm"};
  const PreflightItem profile = item("profile");
  EXPECT_EQ(profile.verdict, Verdict::NotKnown);
  EXPECT_EQ(profile.value, 2);
  EXPECT_THAT(profile.text, HasSubstr("projection.irradiance_mw_per_cm2, resin.penetration_mm"));
  EXPECT_FALSE(preflight_of(stack, machine, summary).holds());
}

TEST_F(PreflightTest, HoldsAJobForAnIslandAndNamesItsPlace) {
  summary.check.findings.push_back({Finding::Kind::Island, LayerIndex{2}, LayerIndex{3}, {1.5, 2.5}, 0.25});
  const PreflightItem islands = item("islands");
  EXPECT_EQ(islands.verdict, Verdict::Held);
  EXPECT_EQ(islands.layer, LayerIndex{2});
  EXPECT_THAT(islands.text, HasSubstr("(1.5, 2.5) mm"));
  EXPECT_THAT(preflight_of(stack, machine, summary).why_held(), HasSubstr("islands: 1 found"));
}

TEST_F(PreflightTest, HoldsWhatTheCalibrationLeavesOpenAndShowsItsBand) {
  const double layer_mm = stack.header().layer_thickness_mm;
  EXPECT_THAT(item("dose").text, testing::Not(HasSubstr("95 %"))) << "nobody measured";
  summary.cure_depth_mm = 2 * layer_mm;
  summary.calibration = CalibrationBand{1.5 * layer_mm, 2.5 * layer_mm, 0.03};
  EXPECT_EQ(item("dose").verdict, Verdict::Passed);
  EXPECT_THAT(item("dose").text, HasSubstr("by the calibration, 95 %"));
  summary.calibration->least_depth_mm = 0.9 * layer_mm;
  EXPECT_EQ(item("dose").verdict, Verdict::Held);
  EXPECT_THAT(item("dose").text, HasSubstr("at the lower end they would not stick together"));

  summary.thin.dose_known = true;
  summary.thin.walls.weakest = ThinFeature{{NarrowPlace::Kind::Wall, {4, 5}, 0.08, 1}, LayerIndex{7}, 0.021};
  EXPECT_EQ(item("latitude").verdict, Verdict::Held);
  EXPECT_THAT(item("latitude").text, HasSubstr("knows the dose to 3.0 % (95 %)"));
  summary.calibration->dose_share = 0.02;
  EXPECT_EQ(item("latitude").verdict, Verdict::Warning) << "inside what is known";
  summary.calibration->dose_share = 0.03;
  summary.thin.walls.weakest->latitude = -0.01;
  EXPECT_EQ(item("latitude").verdict, Verdict::Warning) << "lost whatever the calibration";
}

TEST_F(PreflightTest, WarnsOfAHollowWithoutHoldingTheJob) {
  summary.check.findings.push_back({Finding::Kind::SuctionCup, LayerIndex{1}, LayerIndex{2}, {0, 0}, 3});
  EXPECT_EQ(item("hollows").verdict, Verdict::Warning);
  EXPECT_FALSE(preflight_of(stack, machine, summary).holds());
}

TEST_F(PreflightTest, HoldsAJobThatDoesNotCarryThePullAndNamesPlaceStressAndLimit) {
  EXPECT_EQ(item("carry").verdict, Verdict::Passed);
  CarryPlace place{CarryPlace::Check::Lever, LayerIndex{9}, LayerIndex{4}, {1.5, 2.5}, 0.25, 40, {3, 4}, 125.5};
  summary.carry.lever = place;
  summary.carry.weak = {place};
  machine.motion.pull_kpa = 20;
  machine.resin.green_strength_mpa = 10;
  const PreflightItem carry = item("carry");
  EXPECT_EQ(carry.verdict, Verdict::Held);
  EXPECT_EQ(carry.layer, LayerIndex{4});
  EXPECT_EQ(carry.place, (Point2{1.5, 2.5}));
  EXPECT_EQ(carry.value, 125.5);
  EXPECT_THAT(carry.text,
              HasSubstr("at (1.5, 2.5) mm bear 2.51 MPa (by lever) while layer 9 is pulled with 0.8 N from 40 mm2"));
  EXPECT_THAT(carry.text, HasSubstr("allowed are 2.50 MPa, that is 125 times the pull of 20 kPa"));
  EXPECT_THAT(preflight_of(stack, machine, summary).why_held(), HasSubstr("carry: "));
  const auto let = let_through(preflight_of(stack, machine, summary), "carry");
  ASSERT_TRUE(let);
  EXPECT_THAT(*let, HasSubstr("although carry: "));
  machine.motion.pull_kpa = 10;
  EXPECT_EQ(item("carry").verdict, Verdict::Passed);
}

TEST_F(PreflightTest, WarnsOfWhatMayTearWithoutTheLossOfThePrint) {
  machine.motion.pull_kpa = 20;
  machine.resin.green_strength_mpa = 10;
  summary.carry.bending = {CarryPlace::Check::Bending, LayerIndex{9}, LayerIndex{4}, {1.5, 2.5}, 0.25, 40, {3, 4}, 163};
  summary.carry.weak = {*summary.carry.bending};
  summary.carry.without_weak = *summary.carry.bending;
  summary.carry.without_weak->demand = 120.5;
  const PreflightItem carry = item("carry");
  EXPECT_EQ(carry.verdict, Verdict::Warning);
  EXPECT_EQ(carry.place, (Point2{1.5, 2.5}));
  EXPECT_THAT(carry.text, HasSubstr("this place is too weak and may tear"));
  EXPECT_THAT(carry.text, HasSubstr("what is left bears 2.41 MPa at most"));
  EXPECT_FALSE(preflight_of(stack, machine, summary).holds());
}

TEST_F(PreflightTest, SaysWhereThePullOrTheStrengthThatHoldAJobAreAssumed) {
  summary.carry.lever = {CarryPlace::Check::Lever, LayerIndex{9}, LayerIndex{4}, {1.5, 2.5}, 0.25, 40, {3, 4}, 125.5};
  summary.carry.weak = {*summary.carry.lever};
  for (const auto& [pull_kpa, strength_mpa] : {std::pair{0.0, 0.0}, {20.0, 0.0}, {0.0, 10.0}}) {
    machine.motion.pull_kpa = pull_kpa;
    machine.resin.green_strength_mpa = strength_mpa;
    const PreflightItem carry = item("carry");
    EXPECT_EQ(carry.verdict, Verdict::Held);
    EXPECT_THAT(carry.text, HasSubstr("allowed are 2.50 MPa, that is 125 times the pull of 20 kPa"));
    EXPECT_THAT(carry.text, HasSubstr("pull and strength are assumed: state motion.pull_kpa"));
  }
}

TEST_F(PreflightTest, NamesNoStressThatNeverBuildsUpBecauseThePieceTilts) {
  summary.carry.bending = {
      CarryPlace::Check::Bending, LayerIndex{9}, LayerIndex{4}, {1.5, 2.5}, 0.08, 115, {3, 4}, 800'000};
  summary.carry.weak = {*summary.carry.bending};
  EXPECT_THAT(item("carry").text, HasSubstr("bear more than 250 MPa, so that the piece tilts (by bending)"));
}

TEST_F(PreflightTest, WarnsOfWhatHoldsLittleAndDoesNotCarry) {
  summary.carry.weak_small = {
      {CarryPlace::Check::Bending, LayerIndex{9}, LayerIndex{4}, {1.5, 2.5}, 0.05, 8, {3, 4}, 300}};
  const PreflightItem carry = item("carry");
  EXPECT_EQ(carry.verdict, Verdict::Warning);
  EXPECT_EQ(carry.place, (Point2{1.5, 2.5}));
  EXPECT_THAT(carry.text, HasSubstr("1 such places hold little each"));
  EXPECT_FALSE(preflight_of(stack, machine, summary).holds());
}

TEST_F(PreflightTest, SaysWhereItCouldNotJudgeWhetherThePrintCarries) {
  summary.carry.afloat_mm2 = 3;
  EXPECT_EQ(item("carry").verdict, Verdict::NotKnown);
  EXPECT_THAT(item("carry").text, HasSubstr("3.00 mm2 of a layer hang on nothing"));
}

TEST_F(PreflightTest, ResinAndPeelAreHeldAgainstTheProfilesLimitsAndNoPeelIsNamedWithoutOne) {
  EXPECT_EQ(item("resin").verdict, Verdict::NotKnown);
  for (const PreflightItem& each : preflight_of(stack, machine, summary).items) EXPECT_NE(each.name, "peel");
  EXPECT_GT(summary.peel.most_mm2, 0);
  machine.resin.vat_ml = summary.cured_mm3 / 1000 * 1.01;
  machine.platform.most_peel_mm2 = summary.peel.most_mm2 * 1.01;
  EXPECT_EQ(item("resin").verdict, Verdict::Passed);
  EXPECT_EQ(item("peel").verdict, Verdict::Passed);
  machine.resin.vat_ml = summary.cured_mm3 / 1000 * 0.99;
  machine.platform.most_peel_mm2 = summary.peel.most_mm2 * 0.99;
  EXPECT_EQ(item("resin").verdict, Verdict::Held);
  EXPECT_EQ(item("peel").verdict, Verdict::Held);
}

TEST_F(PreflightTest, SaysHowTheMasksWereMadeAndWarnsWhereTimeWasOut) {
  EXPECT_EQ(item("masks").verdict, Verdict::Passed);
  EXPECT_THAT(item("masks").text, HasSubstr("by blend-stack: "));
  summary.pattern.kind = InnerPattern::Kind::Checker;
  EXPECT_THAT(item("masks").text, HasSubstr("checker inside of a shell of 1 mm"));
  summary.mask_figures.tiles = 90;
  summary.mask_figures.unsolved = 10;
  EXPECT_EQ(item("masks").verdict, Verdict::Warning);
  EXPECT_THAT(item("masks").text, HasSubstr("time was out for 10 of 100 tiles"));
  summary.masks = MaskMethod::Cover;
  EXPECT_THAT(item("masks").text, HasSubstr("by cover"));
}

TEST_F(PreflightTest, WarnsOfWallsThatThePixelsAreTooCoarseForAndNamesTheNarrowest) {
  EXPECT_EQ(item("features").verdict, Verdict::Passed);
  std::vector<std::vector<Contour>> rings(4, {test::rectangle(5, 5, 15, 15)});
  rings.resize(12, {test::rectangle(10, 6, 10.06, 14)});
  stack = test::stack_of(rings);
  summary = plan();
  const PreflightItem features = item("features");
  EXPECT_EQ(features.verdict, Verdict::Warning);
  EXPECT_NEAR(features.value.value(), 0.06, 1e-9);
  EXPECT_THAT(features.text, HasSubstr("8 layers have walls and 0 layers gaps narrower than a pixel, 0.100 mm"));
  EXPECT_NEAR(features.place.value().x_mm, 10.03, 1e-9);
  EXPECT_FALSE(preflight_of(stack, machine, summary).holds());
}

TEST_F(PreflightTest, WarnsOfWhatASmallErrorOfTheDoseLosesAndSaysWhatItBears) {
  EXPECT_EQ(item("latitude").verdict, Verdict::Passed);
  summary.thin.walls.weak_layers = 3;
  summary.thin.walls.weakest = {{NarrowPlace::Kind::Wall, {4, 5}, 0.08, 1}, LayerIndex{7}, 0.021};
  summary.thin.gaps.weakest = {{NarrowPlace::Kind::Gap, {6, 7}, 0.09, 1}, LayerIndex{8}, 0.2};
  const PreflightItem latitude = item("latitude");
  EXPECT_EQ(latitude.verdict, Verdict::Warning);
  EXPECT_EQ(latitude.layer, LayerIndex{7});
  EXPECT_THAT(latitude.text, HasSubstr("5 % less dose loses walls in 3 layers"));
  EXPECT_THAT(latitude.text, HasSubstr("a wall of 0.080 mm in layer 7 at (4.0, 5.0) mm, bears 2.1 %"));
  summary.thin.gaps.weakest->latitude = -0.01;
  EXPECT_THAT(item("latitude").text, HasSubstr("a gap of 0.090 mm in layer 8 at (6.0, 7.0) mm, is lost as planned"));
  summary.thin.dose_known = false;
  EXPECT_EQ(item("latitude").verdict, Verdict::NotKnown);
}

TEST_F(PreflightTest, HoldsAJobWhoseDoseDoesNotCureThroughALayer) {
  EXPECT_EQ(item("dose").verdict, Verdict::Passed);
  machine.resin.critical_dose_mj_per_cm2 = 20 / std::exp(0.1 / 0.2 * 1.1);  // 1.1 layers deep
  summary = plan();
  EXPECT_EQ(item("dose").verdict, Verdict::Warning);
  machine.resin.critical_dose_mj_per_cm2 = 20 / std::exp(0.1 / 0.2 * 0.9);
  summary = plan();
  EXPECT_EQ(item("dose").verdict, Verdict::Held);
  EXPECT_THAT(item("dose").text, HasSubstr("would not stick together"));
}

TEST_F(PreflightTest, PeelIsTheAreaOfTheLargestLayer) {
  double most_mm2 = 0;
  for (const Layer& layer : stack.layers()) {
    double area_mm2 = 0;
    for (const Contour& ring : layer.contours) area_mm2 += ring.signed_area_mm2();
    most_mm2 = std::max(most_mm2, area_mm2);
  }
  EXPECT_GE(summary.peel.most_mm2, 0.99 * most_mm2);
}

TEST_F(PreflightTest, AFlaggedLayerIsAWarningWithTheSlicersReason) {
  std::vector<Layer> layers{stack.layers().begin(), stack.layers().end()};
  for (Layer& layer : layers) layer.certificate.verdict = LayerCertificate::Verdict::Measured;
  layers[1].certificate.flag({.reason = DoubtReason::GapBridged, .place = Point2{3, 4}, .size_mm = 2});
  stack = LayerStack::from_layers(stack.header(), std::move(layers)).value();
  const PreflightItem certificates = item("certificates");
  EXPECT_EQ(certificates.verdict, Verdict::Warning);
  EXPECT_EQ(certificates.layer, LayerIndex{1 + summary.elevation_layers});
  EXPECT_THAT(certificates.text, HasSubstr("a gap of 2 mm"));
}

TEST_F(PreflightTest, HoldsAJobWhoseLayersLackContours) {
  std::vector<Layer> layers{stack.layers().begin(), stack.layers().end()};
  layers[0].certificate.flag({.reason = DoubtReason::GapBridged, .place = Point2{3, 4}, .size_mm = 2});
  layers[2].certificate.flag(
      {.reason = DoubtReason::ContoursLeftOut, .place = Point2{3, 4}, .size_mm = 20, .other_mm = 1});
  stack = LayerStack::from_layers(stack.header(), std::move(layers)).value();
  const PreflightItem certificates = item("certificates");
  EXPECT_EQ(certificates.verdict, Verdict::Held);
  EXPECT_EQ(certificates.layer, LayerIndex{2 + summary.elevation_layers});
  EXPECT_THAT(certificates.text, HasSubstr("1 of"));
  EXPECT_THAT(certificates.text, HasSubstr("--complete"));
}

TEST_F(PreflightTest, WarnsOfAPartThatEndsALittleWithinItsScanAndHoldsOneThatLacksMore) {
  const auto with_empty_ends = [&](std::uint32_t below, std::uint32_t above) {
    StackHeader header = stack.header();
    header.layer_count = 200;
    std::vector<Layer> layers(header.layer_count);
    for (std::uint32_t i = 0; i < header.layer_count; ++i) {
      layers[i].index = LayerIndex{i};
      layers[i].z_mm = cut_height_mm(LayerIndex{i}, header.layer_thickness_mm);
      layers[i].certificate.verdict = LayerCertificate::Verdict::Measured;
      if (i >= below && i < header.layer_count - above)
        layers[i].contours = {test::rectangle(5, 5, 10, 10)};
      else
        layers[i].certificate.flag({.reason = DoubtReason::ContourMissing, .place = Point2{3, 4}});
    }
    stack = LayerStack::from_layers(header, std::move(layers)).value();
    return item("certificates");
  };
  const PreflightItem tip = with_empty_ends(1, 3);
  EXPECT_EQ(tip.verdict, Verdict::Warning);
  EXPECT_THAT(tip.text, HasSubstr(fmt::format("the part ends {:.2f} mm within the outermost samples",
                                              4 * stack.header().layer_thickness_mm)));
  EXPECT_EQ(with_empty_ends(1, 4).verdict, Verdict::Held) << "2.5 % of its height";
  EXPECT_EQ(with_empty_ends(6, 0).verdict, Verdict::Held);
}

TEST_F(PreflightTest, HoldsAJobWithAnEmptyLayerInsideThePart) {
  EXPECT_EQ(item("empty-layers").verdict, Verdict::Passed);
  std::vector<Layer> layers{stack.layers().begin(), stack.layers().end()};
  ASSERT_GE(layers.size(), 4U);
  layers[2].contours.clear();
  stack = LayerStack::from_layers(stack.header(), layers).value();
  EXPECT_EQ(item("empty-layers").verdict, Verdict::Held);
  EXPECT_EQ(item("empty-layers").layer, LayerIndex{2 + summary.elevation_layers});
  // Empty ones at the top are no gap.
  layers[2] = stack.layers()[1];
  layers[2].index = LayerIndex{2};
  layers[2].z_mm = stack.layers()[2].z_mm;
  layers.back().contours.clear();
  stack = LayerStack::from_layers(stack.header(), layers).value();
  EXPECT_EQ(item("empty-layers").verdict, Verdict::Passed);
}

TEST_F(PreflightTest, HoldsCompletedContoursAgainstTheLimitsOfTheOperator) {
  EXPECT_EQ(item("surface").verdict, Verdict::Passed);
  std::vector<Layer> layers{stack.layers().begin(), stack.layers().end()};
  Contour& ring = layers[1].contours[0];
  ring = ring.with_runs(std::vector(ring.vertices().size(), SurfaceRun{SurfaceClass::Completed, 1, 3, 0.9})).value();
  layers[1].certificate.verdict = LayerCertificate::Verdict::Completed;
  stack = LayerStack::from_layers(stack.header(), layers).value();
  EXPECT_EQ(item("surface").verdict, Verdict::Warning);
  EXPECT_EQ(item("surface").layer, LayerIndex{1 + summary.elevation_layers});
  EXPECT_THAT(item("surface").text, HasSubstr("up to 3.00 mm"));
  summary.contour_limits = {.completed_share = 1, .doubtful_share = 0, .gap_mm = 3, .error_mm = 0.9};
  EXPECT_EQ(item("surface").verdict, Verdict::Warning);
  summary.contour_limits = {.error_mm = 0.8};
  EXPECT_EQ(item("surface").verdict, Verdict::Held);
  EXPECT_THAT(item("surface").text, HasSubstr("--most-error-mm"));
  summary.contour_limits = {.gap_mm = 2.9};
  EXPECT_EQ(item("surface").verdict, Verdict::Held);
  summary.contour_limits = {.completed_share = 0.001};
  EXPECT_EQ(item("surface").verdict, Verdict::Held);
}

TEST_F(PreflightTest, TellsTheRegistrationErrorWhereTheScanStatesIt) {
  const auto items = preflight_of(stack, machine, summary).items;
  EXPECT_TRUE(std::none_of(items.begin(), items.end(), [](const auto& each) { return each.name == "registration"; }));
  summary.registration_rms_mm = 0.02;
  EXPECT_EQ(item("registration").verdict, Verdict::Passed);
  summary.registration_rms_mm = 0.2;
  EXPECT_EQ(item("registration").verdict, Verdict::Warning);
  EXPECT_FALSE(preflight_of(stack, machine, summary).holds());
}

TEST_F(PreflightTest, JsonTellsVerdictsValuesAndPlaces) {
  summary.check.findings.push_back({Finding::Kind::Island, LayerIndex{2}, LayerIndex{3}, {1.5, 2.5}, 0.25});
  const auto json = nlohmann::json::parse(to_json(preflight_of(stack, machine, summary)));
  EXPECT_EQ(json["verdict"], "held");
  bool found = false;
  for (const auto& each : json["items"])
    if (each["name"] == "islands") {
      found = true;
      EXPECT_EQ(each["place"], (nlohmann::json{1.5, 2.5}));
      EXPECT_EQ(each["layer"], 2);
    }
  EXPECT_TRUE(found);
}

TEST(Preflight, LetsAHeldJobThroughOnlyByTheNameOfEverythingThatHoldsIt) {
  Preflight preflight;
  preflight.items = {{"size", Verdict::Passed, "3 mm", 3, "mm", {}, {}},
                     {"islands", Verdict::Held, "1 found", 1, "findings", LayerIndex{4}, Point2{1, 2}},
                     {"supports", Verdict::Held, "2 found", 2, "findings", {}, {}}};
  EXPECT_EQ(let_through(preflight, "").error().code, ErrorCode::NotPermitted);
  EXPECT_NE(let_through(preflight, "").error().what.find("--although islands,supports"), std::string::npos);
  EXPECT_EQ(let_through(preflight, "islands").error().code, ErrorCode::NotPermitted);
  EXPECT_EQ(let_through(preflight, "islnds,supports").error().code, ErrorCode::InvalidInput);
  const auto why = let_through(preflight, "supports,islands");
  ASSERT_TRUE(why) << why.error().what;
  EXPECT_EQ(*why, "although islands: 1 found; supports: 2 found");
  preflight.items[1].verdict = preflight.items[2].verdict = Verdict::Warning;
  EXPECT_EQ(*let_through(preflight, ""), "");
}

TEST(Preflight, ComesBackFromItsJsonAndHoldsWhatItDoesNotUnderstand) {
  Preflight preflight;
  preflight.items = {{"islands", Verdict::Held, "1 found", 1, "findings", LayerIndex{4}, Point2{1, 2}},
                     {"time", Verdict::NotKnown, "?", {}, "s", {}, {}}};
  const auto back = preflight_from_json(to_json(preflight));
  ASSERT_TRUE(back) << back.error().what;
  EXPECT_EQ(to_json(*back), to_json(preflight));
  EXPECT_TRUE(preflight_from_json(R"({"verdict":"held","items":[{"name":"a","verdict":"??","text":""}]})")->holds());
  for (const char* text : {"", "[]", "{}", R"({"verdict":"held","items":[]})", R"({"verdict":"passed","items":[{}]})"})
    EXPECT_FALSE(preflight_from_json(text)) << text;
}

}  // namespace
}  // namespace telefab::fab
