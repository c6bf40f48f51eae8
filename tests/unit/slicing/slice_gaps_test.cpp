// SPDX-License-Identifier: GPL-3.0-or-later
// Scans that do not show the whole surface: gaps, one side only, sheets, no underside.
#include "sliced.hpp"

#include <numbers>

namespace telefab::scan {
namespace {

TEST(SliceScan, CarriesTheSurfaceAcrossAGapAndSaysWhere) {
  const auto torn =
      test::sample_surface(*test::sphere(10, 1), {.spacing_mm = 0.7, .holes = {{{10, 0, 0}, 4}}, .seed = 12});
  const Outcome outcome = slice(text_of(torn), request_for());
  ASSERT_TRUE(outcome.report) << outcome.report.error().what;
  EXPECT_TRUE(outcome.report->gaps.empty());
  EXPECT_GT(outcome.report->completion.virtual_samples, 20U);
  EXPECT_NEAR(outcome.report->completion.largest_gap_mm, 4, 0.5);
  // The middle of the ball, wherever the box of its samples put it.
  const Transform4& placed = outcome.report->header.scan_to_build;
  const Vec3 centre{placed[3], placed[7], placed[11]};
  for (const Layer& layer : outcome.layers) {
    ASSERT_EQ(layer.contours.size(), 1U) << layer.z_mm;
    double gap_mm = 0, error_mm = 0;
    for (const SurfaceRun& run : layer.contours[0].runs()) {
      gap_mm = std::max(gap_mm, run.gap_mm);
      error_mm = std::max(error_mm, run.error_mm);
    }
    const double radius2 = 100 - std::pow(layer.z_mm - centre.z(), 2);
    if (std::abs(layer.z_mm - centre.z()) > 8.5) continue;
    EXPECT_NEAR(layer.contours[0].signed_area_mm2(), std::numbers::pi * radius2, 0.02 * 314) << layer.z_mm;
    if (std::abs(layer.z_mm - centre.z()) < 2.5) {
      EXPECT_EQ(layer.certificate.verdict, LayerCertificate::Verdict::Completed) << layer.z_mm;
      EXPECT_GT(gap_mm, 1.5);
      for (const Point2& p : layer.contours[0].vertices())
        EXPECT_LT(std::abs(std::hypot(p.x_mm - centre.x(), p.y_mm - centre.y()) - std::sqrt(radius2)),
                  std::max(error_mm, 0.1));
    } else if (std::abs(layer.z_mm - centre.z()) > 6) {
      EXPECT_EQ(layer.certificate.verdict, LayerCertificate::Verdict::Measured) << layer.z_mm;
    }
  }
}

// The smoothest surface through both ends foretells what is measured of the limb: it goes on.
TEST(SliceScan, JoinsTheEndsOfASmoothLimbThatWasCutThrough) {
  const auto torn =
      test::sample_surface(*test::torus(12, 4, 90, 1), {.spacing_mm = 0.7, .holes = {{{0, 12, 0}, 9}}, .seed = 12});
  const Outcome outcome = slice(text_of(torn), request_for());
  ASSERT_TRUE(outcome.report) << outcome.report.error().what;
  const Layer& middle = outcome.layers[outcome.layers.size() / 2];
  EXPECT_EQ(middle.contours.size(), 2U);
  EXPECT_EQ(middle.certificate.verdict, LayerCertificate::Verdict::Completed);
}

// Of a rough scan nothing foretells whether the limb goes on: both ways of closing the gap are whole bodies.
TEST(SliceScan, DoubtsTheLayersBetweenTheEndsOfARoughLimbThatWasCutThrough) {
  auto torn =
      test::sample_surface(*test::torus(12, 4, 90, 1), {.spacing_mm = 0.7, .holes = {{{0, 12, 0}, 9}}, .seed = 12});
  for (std::size_t i = 0; i < torn.points.size(); ++i) torn.points[i] += (i % 2 == 0 ? 0.15 : -0.15) * torn.normals[i];
  const Outcome outcome = slice(text_of(torn), request_for());
  ASSERT_TRUE(outcome.report) << outcome.report.error().what;
  const Layer& middle = outcome.layers[outcome.layers.size() / 2];
  EXPECT_EQ(middle.contours.size(), 1U);
  EXPECT_EQ(middle.certificate.verdict, LayerCertificate::Verdict::Doubtful);
  ASSERT_TRUE(middle.certificate.doubt);
  EXPECT_EQ(middle.certificate.doubt->reason, DoubtReason::CriticalInGap);
}

TEST(SliceScan, CompletesNothingWhereNothingIsMissing) {
  SliceRequest request = request_for();
  const Outcome asked = slice(torus_text(), request);
  request.complete = false;
  const Outcome off = slice(torus_text(), request);
  ASSERT_TRUE(asked.report && off.report);
  EXPECT_EQ(asked.report->completion.virtual_samples, 0U);
  EXPECT_EQ(asked.layers, off.layers);
  for (const Layer& layer : asked.layers) EXPECT_NE(layer.certificate.verdict, LayerCertificate::Verdict::Completed);
}

TEST(SliceScan, LeavesNothingOutThoughItMayNotComplete) {
  const auto torn =
      test::sample_surface(*test::sphere(10, 1), {.spacing_mm = 0.6, .holes = {{{10, 0, 0}, 4}}, .seed = 12});
  SliceRequest request = request_for();
  request.complete = false;
  const Outcome outcome = slice(text_of(torn), request);
  ASSERT_TRUE(outcome.report) << outcome.report.error().what;
  EXPECT_EQ(outcome.report->completion.virtual_samples, 0U);
  const Layer& middle = outcome.layers[outcome.layers.size() / 2];
  ASSERT_EQ(middle.contours.size(), 1U);
  EXPECT_EQ(middle.certificate.verdict, LayerCertificate::Verdict::Doubtful);
  ASSERT_TRUE(middle.certificate.doubt);
  EXPECT_EQ(middle.certificate.doubt->reason, DoubtReason::GapBridged);
  EXPECT_NEAR(middle.certificate.doubt->size_mm, 7.5, 1.5);
  // Flat: the cap's chord is cut off.
  EXPECT_LT(middle.contours[0].signed_area_mm2(), 314);
  EXPECT_GT(middle.contours[0].signed_area_mm2(), 295);
  EXPECT_NE(to_json(*outcome.report).find("\"bridged\":true"), std::string::npos);
}

TEST(SliceScan, ClosesGapsAsFarAsAsked) {
  EXPECT_TRUE(complete_gaps_as("auto", *std::make_unique<SliceRequest>()));
  SliceRequest request = request_for();
  ASSERT_TRUE(complete_gaps_as("off", request));
  EXPECT_FALSE(request.complete);
  ASSERT_TRUE(complete_gaps_as("2.5", request));
  EXPECT_TRUE(request.complete);
  EXPECT_EQ(request.most_gap_mm, 2.5);
  EXPECT_FALSE(complete_gaps_as("wide", request));
  EXPECT_FALSE(complete_gaps_as("2mm", request));
  request.most_gap_mm = -1;
  EXPECT_FALSE(request.validate());
}

TEST(SliceScan, GivesTheSameCompletedLayersOnAnyNumberOfThreadsAndForAnyRange) {
  const std::string torn =
      text_of(test::sample_surface(*test::sphere(10, 1), {.spacing_mm = 0.7, .holes = {{{10, 0, 0}, 4}}, .seed = 12}));
  SliceRequest request = request_for();
  request.threads = 1;
  const Outcome one = slice(torn, request);
  request.threads = 8;
  const Outcome eight = slice(torn, request);
  ASSERT_TRUE(one.report && eight.report);
  EXPECT_EQ(one.layers, eight.layers);
  request.layers = {{18, 19}};
  const Outcome part = slice(torn, request);
  ASSERT_EQ(part.layers.size(), 2U);
  EXPECT_EQ(part.layers[0], one.layers[18]);
}

TEST(SliceScan, RefusesAScanOfOneSideAndSaysWhatToDo) {
  const auto ball = test::sample_surface(*test::sphere(10, 1), {.spacing_mm = 0.6, .seed = 15});
  test::SurfaceSamples front;
  for (std::size_t i = 0; i < ball.points.size(); ++i)
    if (ball.points[i].x() > 2) {
      front.points.push_back(ball.points[i]);
      front.normals.push_back(ball.normals[i]);
    }
  const Outcome refused = slice(text_of(front), request_for());
  ASSERT_FALSE(refused.report);
  EXPECT_EQ(refused.report.error().code, ErrorCode::InvalidInput);
  EXPECT_NE(refused.report.error().what.find("towards -x"), std::string::npos) << refused.report.error().what;
  EXPECT_NE(refused.report.error().what.find("scan that side too"), std::string::npos);
}

TEST(SliceScan, SaysWhatReadingNoticedWhereItRefuses) {
  std::string text =
      "ply\nformat ascii 1.0\nelement vertex 1601\nproperty float x\nproperty float y\nproperty float z\n"
      "end_header\nnan nan nan\n";
  for (int i = 0; i < 40; ++i)
    for (int j = 0; j < 40; ++j) text += fmt::format("{} {} {}\n", 0.5 * i, 0.5 * j, 0.01 * i * j);
  const Outcome refused = slice(text, request_for());
  ASSERT_FALSE(refused.report);
  EXPECT_NE(refused.report.error().what.find("shows too little of the object"), std::string::npos)
      << refused.report.error().what;
  EXPECT_NE(refused.report.error().what.find("noticed: "), std::string::npos) << refused.report.error().what;
}

/// A relief in the y-z plane that looks along +x: a board with a hump of 4 mm.
test::SurfaceSamples relief() {
  test::SurfaceSamples front;
  for (double y = -20; y <= 20; y += 0.4)
    for (double z = 0; z <= 30; z += 0.4) {
      const double r2 = (y * y + (z - 15) * (z - 15)) / 50, hump = 4 * std::exp(-r2);
      front.points.emplace_back(hump, y, z);
      front.normals.push_back(Vec3{1, hump * 2 * y / 50, hump * 2 * (z - 15) / 50}.normalized());
    }
  return front;
}

TEST(SliceScan, MakesAReliefAsThickAsAskedBehindWhatWasScanned) {
  SliceRequest request = request_for();
  request.thickness_mm = 3;
  request.placement.scale = 1;
  const Outcome sheet = slice(text_of(relief()), request);
  ASSERT_TRUE(sheet.report) << sheet.report.error().what;
  EXPECT_NEAR(sheet.report->size_mm[0], 7, 0.1);
  EXPECT_NEAR(sheet.report->size_mm[2], 30, 0.8);
  int seen = 0, certified = 0;
  for (const Layer& layer : sheet.layers) {
    if (layer.z_mm < 2 || layer.z_mm > sheet.report->size_mm[2] - 2) continue;
    ++seen;
    certified += layer.certificate.is_certified();
    ASSERT_EQ(layer.contours.size(), 1U) << layer.z_mm;
    // 40 mm of board, a little more along the hump, rounded at both ends.
    EXPECT_NEAR(layer.contours[0].signed_area_mm2(), 3 * 41, 12) << layer.z_mm;
    const SurfaceShares shares = surface_shares(layer);
    EXPECT_NEAR(shares.measured_mm / shares.length_mm(), 0.5, 0.1) << "the back is not measured";
  }
  EXPECT_GE(certified, 0.9 * seen);
}

TEST(SliceScan, ScalesASheetSoThatItsHeightCountsItsBack) {
  SliceRequest request = request_for();
  request.thickness_mm = 3;
  request.placement.turn = turn_from_up("x").value();
  request.placement.height_mm = 5;
  const Outcome lying = slice(text_of(relief()), request);
  ASSERT_TRUE(lying.report) << lying.report.error().what;
  EXPECT_NEAR(lying.report->size_mm[2], 5, 0.05);
  // 4 mm of hump became 2.
  EXPECT_NEAR(lying.report->size_mm[1], 20, 0.5);
}

TEST(SliceScan, RefusesASheetThinnerThanItsSamplesTell) {
  SliceRequest request = request_for();
  request.thickness_mm = 0.5;
  request.placement.scale = 1;
  const Outcome thin = slice(text_of(relief()), request);
  ASSERT_FALSE(thin.report);
  EXPECT_NE(thin.report.error().what.find("too thin"), std::string::npos) << thin.report.error().what;
}

/// A ball standing on a ragged rim: nothing of it was scanned below a slanted plane.
test::SurfaceSamples bust() {
  const auto ball = test::sample_surface(*test::sphere(10, 1), {.spacing_mm = 0.6, .seed = 15});
  test::SurfaceSamples open;
  for (std::size_t i = 0; i < ball.points.size(); ++i)
    if (ball.points[i].z() > -6 + 0.1 * ball.points[i].x()) {
      open.points.push_back(ball.points[i]);
      open.normals.push_back(ball.normals[i]);
    }
  return open;
}

TEST(SliceScan, SaysThatAScanHasNoUndersideAndWhatToDo) {
  auto half = bust();
  SliceRequest request = request_for();
  request.layers = {{20, 20}};
  const Outcome open = slice(text_of(half), request);
  ASSERT_TRUE(open.report) << open.report.error().what;
  ASSERT_EQ(open.report->warnings.size(), 1U);
  EXPECT_NE(open.report->warnings[0].find("facing down"), std::string::npos) << open.report->warnings[0];
  EXPECT_NE(open.report->warnings[0].find("scan that side too"), std::string::npos);
  // The missing cap has a base circle of radius 8.
  EXPECT_NEAR(open.report->open.missing_mm2.z(), -64 * std::numbers::pi, 30);
  const Outcome closed = slice(torus_text(), request);
  ASSERT_TRUE(closed.report);
  EXPECT_TRUE(closed.report->warnings.empty());
}

TEST(SliceScan, LetsAScanWithoutUndersideEndAtThePlatform) {
  const Outcome outcome = slice(text_of(bust()), request_for());
  ASSERT_TRUE(outcome.report) << outcome.report.error().what;
  EXPECT_TRUE(outcome.report->gaps.empty());
  // The walls go on below the ragged rim, which rises by 1.6 mm: every layer is a disc.
  for (const Layer& layer : outcome.layers) {
    ASSERT_EQ(layer.contours.size(), 1U) << layer.z_mm;
    EXPECT_FALSE(layer.contours[0].is_hole());
  }
  const double lowest = outcome.layers.front().contours[0].signed_area_mm2();
  EXPECT_NEAR(lowest, std::numbers::pi * (100 - 6.8 * 6.8), 0.25 * lowest);
}

TEST(SliceScan, TakesAHalfWithoutUndersideForAFlatBaseOnRequestOnly) {
  const auto ball = test::sample_surface(*test::sphere(10, 1), {.spacing_mm = 0.6, .seed = 15});
  test::SurfaceSamples dome;
  for (std::size_t i = 0; i < ball.points.size(); ++i)
    if (ball.points[i].z() > 0) {
      dome.points.push_back(ball.points[i]);
      dome.normals.push_back(ball.normals[i]);
    }
  SliceRequest request = request_for();
  const Outcome refused = slice(text_of(dome), request);
  ASSERT_FALSE(refused.report);
  EXPECT_NE(refused.report.error().what.find("facing down"), std::string::npos) << refused.report.error().what;
  EXPECT_NE(refused.report.error().what.find("--base flat"), std::string::npos) << refused.report.error().what;
  ASSERT_TRUE(base_as("flat", request));
  const Outcome cut = slice(text_of(dome), request);
  ASSERT_TRUE(cut.report) << cut.report.error().what;
  EXPECT_TRUE(cut.report->warnings.empty());
  EXPECT_TRUE(cut.report->gaps.empty());
  for (const Layer& layer : cut.layers) {
    ASSERT_EQ(layer.contours.size(), 1U) << layer.z_mm;
    if (layer.z_mm < 8) {
      EXPECT_NEAR(layer.contours[0].signed_area_mm2(), std::numbers::pi * (100 - layer.z_mm * layer.z_mm), 16);
    }
  }
  EXPECT_FALSE(base_as("round", request));
}

TEST(SliceScan, AdvisesAFlatBaseWhereThatIsAllThatIsLackingThoughAnotherSideIsOpenToo) {
  const auto ball = test::sample_surface(*test::sphere(10, 1), {.spacing_mm = 0.6, .seed = 15});
  test::SurfaceSamples figure;  // no underside, and a hole in its back
  for (std::size_t i = 0; i < ball.points.size(); ++i)
    if (ball.points[i].z() > -6 && ball.points[i].x() > -5.5) {
      figure.points.push_back(ball.points[i]);
      figure.normals.push_back(ball.normals[i]);
    }
  SliceRequest request = request_for();
  const Outcome refused = slice(text_of(figure), request);
  ASSERT_FALSE(refused.report);
  EXPECT_EQ(refused.report.error().what.find("facing down"), std::string::npos) << refused.report.error().what;
  EXPECT_NE(refused.report.error().what.find("--base flat"), std::string::npos) << refused.report.error().what;
  ASSERT_TRUE(base_as("flat", request));
  EXPECT_TRUE(slice(text_of(figure), request).report);
}

}  // namespace
}  // namespace telefab::scan
