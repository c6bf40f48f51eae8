// SPDX-License-Identifier: GPL-3.0-or-later
#include <telefab/scan/slicing/slice_scan.hpp>

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <numbers>
#include <random>
#include <telefab/scan/formats/write_cloud.hpp>
#include <telefab/scan/slicing/preview.hpp>
#include <telefab/test/analytic_field.hpp>
#include <telefab/test/las_file.hpp>
#include <telefab/test/surface_samples.hpp>

#include "sliced.hpp"

namespace telefab::scan {
namespace {

TEST(SliceScan, DoubtsWhatRunsWhereTheScanShowsTwoSheetsAndVouchesForTheRest) {
  PointCloud cloud;
  const auto samples = test::sample_surface(*test::torus(9, 4, 90, 1), {.spacing_mm = 0.7, .seed = 11});
  for (std::size_t i = 0; i < samples.points.size(); ++i) {
    cloud.points.push_back(samples.points[i].cast<float>());
    cloud.normals.push_back(samples.normals[i].cast<float>());
    const Vec3& p = samples.points[i];
    cloud.sheets_apart.push_back(p.z() > 0 && p.y() > 5 ? 0.4F : 0.F);
  }
  const auto bytes = write_ply(cloud, {}, "x");
  const Outcome outcome = slice(std::string{reinterpret_cast<const char*>(bytes.data()), bytes.size()}, request_for());
  ASSERT_TRUE(outcome.report) << outcome.report.error().what;
  ASSERT_EQ(outcome.report->warnings.size(), 1U);
  EXPECT_THAT(outcome.report->warnings[0], testing::HasSubstr("lie on two sheets, up to 0.4 mm apart"));
  const double middle = outcome.report->header.scan_to_build[11];
  std::size_t doubtful = 0, sound = 0;
  for (const Layer& layer : outcome.layers) {
    if (layer.z_mm < middle - 1.5) {
      EXPECT_TRUE(layer.certificate.is_certified()) << layer.z_mm;
      ++sound;
    }
    if (layer.z_mm < middle + 1 || layer.z_mm > middle + 3) continue;
    ++doubtful;
    ASSERT_TRUE(layer.certificate.doubt) << layer.z_mm;
    EXPECT_EQ(layer.certificate.doubt->reason, DoubtReason::SheetsDoubled);
    EXPECT_NEAR(layer.certificate.doubt->size_mm, 0.4, 1e-5);
    const SurfaceShares shares = surface_shares(layer);
    EXPECT_GT(shares.doubtful_mm, 0.05 * shares.length_mm());
    EXPECT_LT(shares.doubtful_mm, 0.6 * shares.length_mm()) << "the other of the two contours";
  }
  EXPECT_GT(sound, 3U);
  EXPECT_GT(doubtful, 2U);
}

TEST(SliceScan, CertifiesEveryLayerOfATorusWithTheRightRings) {
  const Outcome outcome = slice(torus_text(), request_for());
  ASSERT_TRUE(outcome.report) << outcome.report.error().what;
  EXPECT_EQ(outcome.layers.size(), 52U);
  EXPECT_EQ(outcome.report->surface_euler, 0);
  EXPECT_TRUE(outcome.report->flagged.empty()) << sentence_of(outcome.report->flagged[0].certificate);
  for (const Layer& layer : outcome.layers) {
    EXPECT_EQ(layer.certificate.verdict, LayerCertificate::Verdict::Measured);
    // The ring stands upright: one outline below and above the hole, two beside it.
    const double from_middle = std::abs(layer.z_mm - 13);
    if (from_middle < 4.8 || (from_middle > 5.2 && from_middle < 12.9)) {
      EXPECT_EQ(layer.contours.size(), from_middle < 5 ? 2U : 1U) << layer.z_mm;
    }
    for (const Contour& c : layer.contours) EXPECT_FALSE(c.is_hole());
  }
}

TEST(SliceScan, EnclosesTheVolumeOfTheTorus) {
  const Outcome outcome = slice(torus_text(), request_for());
  double volume = 0;
  for (const Layer& layer : outcome.layers)
    for (const Contour& c : layer.contours) volume += 0.5 * c.signed_area_mm2();
  const double truth = 2 * std::numbers::pi * std::numbers::pi * 9 * 4 * 4;
  EXPECT_NEAR(volume, truth, 0.003 * truth);
}

TEST(SliceScan, CentresThePartOnThePlatformAndSaysHow) {
  const Outcome outcome = slice(torus_text(), request_for());
  ASSERT_TRUE(outcome.report);
  const Transform4& t = outcome.report->header.scan_to_build;
  EXPECT_NEAR(t[3], 30 - 100, 0.1);
  EXPECT_NEAR(t[7], 20 - 200, 0.1);
  EXPECT_NEAR(t[11], 300 + 13, 0.1);
  EXPECT_NE(to_json(*outcome.report).find("\"scan_to_build\":[[1.0,0.0,0.0,"), std::string::npos);
}

TEST(SliceScan, GivesTheSameBytesOnAnyNumberOfThreads) {
  const std::string one = slice(torus_text(), request_for(1)).text;
  EXPECT_FALSE(one.empty());
  EXPECT_EQ(slice(torus_text(), request_for(2)).text, one);
  EXPECT_EQ(slice(torus_text(), request_for(8)).text, one);
}

TEST(SliceScan, CutsARangeOfLayersToTheSameBytesAsTheWhole) {
  const Outcome whole = slice(torus_text(), request_for());
  SliceRequest part = request_for();
  part.layers = {{9, 22}};
  const Outcome range = slice(torus_text(), part);
  ASSERT_EQ(range.layers.size(), 14U);
  for (std::size_t i = 0; i < range.layers.size(); ++i) EXPECT_EQ(range.layers[i], whole.layers[i + 9]);
}

TEST(SliceScan, FindsTheSameRingsByGridAndByMarching) {
  SliceRequest grid = request_for();
  grid.method = TraceMethod::Grid;
  const Outcome by_grid = slice(torus_text(), grid);
  const Outcome marched = slice(torus_text(), request_for());
  ASSERT_EQ(by_grid.layers.size(), marched.layers.size());
  for (std::size_t i = 0; i < by_grid.layers.size(); ++i) {
    EXPECT_EQ(by_grid.layers[i].contours.size(), marched.layers[i].contours.size()) << "layer " << i;
    double a = 0, b = 0, around_mm = 0;
    for (const Contour& c : by_grid.layers[i].contours) a += c.signed_area_mm2();
    for (const Contour& c : marched.layers[i].contours) {
      b += c.signed_area_mm2();
      around_mm += c.length_mm();
    }
    // The chords of both lie on one side of the section and leave it by their tolerance at most; an arc encloses two
    // thirds of its height times its chord.
    EXPECT_NEAR(a, b, 2.0 / 3 * around_mm * grid.machine.chord_tolerance_mm()) << "layer " << i;
  }
}

TEST(SliceScan, ScalesToHeightAndToFit) {
  SliceRequest request = request_for();
  request.placement.height_mm = 13;
  const Outcome small = slice(torus_text(), request);
  ASSERT_TRUE(small.report);
  EXPECT_NEAR(small.report->size_mm[2], 13, 1e-4);
  EXPECT_EQ(small.layers.size(), 26U);
  request.placement.height_mm.reset();
  request.placement.fit = true;
  request.layers = {{10, 10}};
  const Outcome large = slice(torus_text(), request);
  ASSERT_TRUE(large.report) << large.report.error().what;
  EXPECT_NEAR(large.report->size_mm[1], 0.98 * 40, 0.01);  // the depth is what limits it, less a margin
  EXPECT_LE(large.report->size_mm[0], 60);
}

TEST(SliceScan, RefusesAPartLargerThanTheMachineNamingBothSizes) {
  SliceRequest request = request_for();
  request.placement.height_mm = 80;
  const Outcome outcome = slice(torus_text(), request);
  ASSERT_FALSE(outcome.report);
  EXPECT_EQ(outcome.report.error().code, ErrorCode::InvalidInput);
  EXPECT_NE(outcome.report.error().what.find("x 80 mm"), std::string::npos) << outcome.report.error().what;
  EXPECT_NE(outcome.report.error().what.find("60 x 40 mm platform"), std::string::npos);
  EXPECT_TRUE(outcome.layers.empty());
}

TEST(SliceScan, RefusesWhatCannotBeSliced) {
  for (const std::string scan : {"", "1 2 3\n", "0 0 0 0 0 1\n1 0 0 0 0 1\n0 1 0 0 0 1\n1 1 0 0 0 1\n"})
    EXPECT_FALSE(slice(scan, request_for()).report) << scan;
  SliceRequest two = request_for();
  two.placement.height_mm = 10;
  two.placement.fit = true;
  EXPECT_FALSE(slice(torus_text(), two).report);
  SliceRequest thin = request_for();
  thin.layer_mm = 0;
  EXPECT_FALSE(slice(torus_text(), thin).report);
  SliceRequest beyond = request_for();
  beyond.layers = {{0, 1000}};
  EXPECT_FALSE(slice(torus_text(), beyond).report);
}

TEST(SliceScan, EndsWithTheSinksError) {
  int taken = 0;
  const LayerSink full = [&](const StackHeader&, Layer&&) -> Result<void> {
    if (++taken == 5) return fail(ErrorCode::StorageFailed, "disk full");
    return {};
  };
  const auto report =
      slice_scan(std::as_bytes(std::span{torus_text()}), "torus.xyz", request_for(), full, {}, std::stop_token{});
  ASSERT_FALSE(report);
  EXPECT_EQ(report.error().code, ErrorCode::StorageFailed);
  EXPECT_EQ(taken, 5);
}

TEST(SliceScan, StopsBetweenLayersWhenAsked) {
  std::stop_source stop;
  int taken = 0;
  const LayerSink sink = [&](const StackHeader&, Layer&&) -> Result<void> {
    if (++taken == 3) stop.request_stop();
    return {};
  };
  const auto report =
      slice_scan(std::as_bytes(std::span{torus_text()}), "torus.xyz", request_for(), sink, {}, stop.get_token());
  ASSERT_FALSE(report);
  EXPECT_EQ(report.error().code, ErrorCode::Cancelled);
  EXPECT_LT(taken, 52);
}

/// A ball of 20 units across, and one layer of it cut.
Result<SliceReport> one_layer_of_a_ball(double unit, SliceRequest request) {
  auto ball = test::sample_surface(*test::sphere(10, 1), {.spacing_mm = 0.9, .seed = 21});
  for (Vec3& p : ball.points) p *= unit;
  request.layers = {{0, 0}};
  return slice(text_of(ball), request).report;
}

TEST(SliceScan, TakesTheUnitStatedAndWarnsOfASizeHardlyMeant) {
  SliceRequest in_metres = request_for();
  in_metres.placement.unit_mm = 1000;
  const auto stated = one_layer_of_a_ball(0.001, in_metres);
  ASSERT_TRUE(stated) << stated.error().what;
  EXPECT_NEAR(stated->size_mm[2], 20, 0.5);
  EXPECT_TRUE(stated->warnings.empty());

  const auto unstated = one_layer_of_a_ball(0.001, request_for());
  ASSERT_FALSE(unstated) << "metres without a unit must not become a part of one layer";
  EXPECT_EQ(unstated.error().code, ErrorCode::InvalidInput);
  EXPECT_NE(unstated.error().what.find("say --units m"), std::string::npos) << unstated.error().what;
  SliceRequest meant = request_for();
  meant.placement.unit_mm = 1;
  EXPECT_TRUE(one_layer_of_a_ball(0.05, meant)) << "whoever states the unit is believed";

  SliceRequest sized = request_for();
  sized.placement.height_mm = 20;
  const auto by_height = one_layer_of_a_ball(0.001, sized);
  ASSERT_TRUE(by_height) << by_height.error().what;
  EXPECT_TRUE(by_height->warnings.empty());

  const auto far_too_large = one_layer_of_a_ball(1, in_metres);
  ASSERT_FALSE(far_too_large);
  EXPECT_NE(far_too_large.error().what.find("say --units mm"), std::string::npos) << far_too_large.error().what;

  in_metres.placement.scale = 2;
  EXPECT_FALSE(in_metres.validate());
}

TEST(SliceScan, FindsTheHoleOfATorusBetweenItsRows) {
  // 90 samples around, 36 across: the rows lie farther apart than the samples in the inner ones.
  std::string text;
  for (int i = 0; i < 90; ++i)
    for (int k = 0; k < 36; ++k) {
      const double u = 2 * std::numbers::pi * i / 90, v = 2 * std::numbers::pi * k / 36;
      const Vec3 n{std::cos(v) * std::cos(u), std::cos(v) * std::sin(u), std::sin(v)};
      text += fmt::format("{} {} {} {} {} {}\n", 5 * std::cos(u) + 2 * n.x(), 5 * std::sin(u) + 2 * n.y(), 2 * n.z(),
                          n.x(), n.y(), n.z());
    }
  const Outcome outcome = slice(text, request_for());
  ASSERT_TRUE(outcome.report) << outcome.report.error().what;
  for (const Layer& layer : outcome.layers) {
    ASSERT_EQ(layer.contours.size(), 2U) << "at " << layer.z_mm;
    double area = 0;
    for (const Contour& ring : layer.contours) area += ring.signed_area_mm2();
    const double half_width = std::sqrt(4 - (layer.z_mm - 2) * (layer.z_mm - 2));
    EXPECT_NEAR(area, 20 * std::numbers::pi * half_width, 0.5) << "at " << layer.z_mm;
  }
}

TEST(SliceScan, BelievesAFormatThatStatesItsUnit) {
  const auto ball = test::sample_surface(*test::sphere(10, 1), {.spacing_mm = 0.9, .seed = 21});
  std::vector<std::array<std::int32_t, 3>> points;
  for (const Vec3& p : ball.points) {
    const Eigen::Vector3i whole = (p * 1000).array().round().cast<int>();
    points.push_back({whole.x(), whole.y(), whole.z()});
  }
  SliceRequest request = request_for();
  request.layers = {{0, 0}};
  const auto report = slice(test::las_file(points, {.scale = Vec3::Constant(1e-6)}), request).report;  // LAS: metres
  ASSERT_TRUE(report) << report.error().what;
  EXPECT_NEAR(report->size_mm[2], 20, 0.5);
}

/// A ball of 10 mm as text, and what comes behind it.
std::string ball_text(const std::string& more = {}) {
  return text_of(test::sample_surface(*test::sphere(10, 1), {.spacing_mm = 0.6, .seed = 31})) + more;
}

TEST(SliceScan, LetsNoStrayPointSetSizePlaceOrLayerCount) {
  SliceRequest request = request_for();
  request.placement.height_mm = 20;
  const Outcome clean = slice(ball_text(), request);
  ASSERT_TRUE(clean.report) << clean.report.error().what;
  for (const std::string stray : {"0 0 -400 0 0 1\n", "0 0 22 0 0 1\n", "14 0 0 1 0 0\n", "13 0 0 1 0 0\n",
                                  "0 0 14 0 0 1\n0.2 0 14 0 0 1\n", "500 500 500 0 0 1\n500 501 500 0 0 1\n"}) {
    const Outcome with = slice(ball_text(stray), request);
    ASSERT_TRUE(with.report) << stray << with.report.error().what;
    EXPECT_EQ(with.layers.size(), clean.layers.size()) << stray;
    EXPECT_NEAR(with.report->size_mm[0], clean.report->size_mm[0], 0.2) << stray;
    EXPECT_EQ(with.report->certified, clean.report->certified) << stray;
    EXPECT_GE(with.report->pick.strays, 1U) << stray;
    ASSERT_FALSE(with.report->warnings.empty()) << stray;
    EXPECT_NE(with.report->warnings[0].find("belong to no surface"), std::string::npos) << with.report->warnings[0];
    EXPECT_NE(to_json(*with.report).find("\"strays\""), std::string::npos);
  }
  EXPECT_EQ(clean.report->pick.strays, 0U);
}

TEST(SliceScan, NeverEndsWellWithoutAContour) {
  std::string shell;  // points all around, but no two on one surface: nothing that could be cut
  std::mt19937_64 dice{77};
  const auto place = [&] { return 0.02 * static_cast<double>(dice() % 1000); };
  for (int i = 0; i < 400; ++i) {
    const double x = place(), y = place(), z = place();
    shell += fmt::format("{} {} {}\n", x, y, z);
  }
  const Outcome outcome = slice(shell, request_for());
  if (outcome.report) {
    EXPECT_GT(outcome.report->contours, 0U);
    EXPECT_EQ(outcome.report->certified, 0U);
  } else {
    EXPECT_EQ(outcome.report.error().code, ErrorCode::InvalidInput);
  }
}

TEST(SliceScan, KeepsTwoBodiesAndChoosesOne) {
  auto both = test::sample_surface(*test::sphere(10, 1), {.spacing_mm = 0.6, .seed = 31});
  const auto small = test::sample_surface(*test::sphere(2, 1), {.spacing_mm = 0.3, .seed = 32});
  for (std::size_t i = 0; i < small.points.size(); ++i) {
    both.points.push_back(small.points[i] + Vec3{20, 0, 0});
    both.normals.push_back(small.normals[i]);
  }
  SliceRequest request = request_for();
  const Outcome all = slice(text_of(both), request);
  ASSERT_TRUE(all.report) << all.report.error().what;
  EXPECT_NEAR(all.report->size_mm[0], 32, 0.5);
  EXPECT_EQ(all.layers[all.layers.size() / 2].contours.size(), 2U);
  request.intake.pick.pieces = 1;
  const Outcome one = slice(text_of(both), request);
  ASSERT_TRUE(one.report) << one.report.error().what;
  EXPECT_NEAR(one.report->size_mm[0], 20, 0.5);
  request.intake.pick = {.crop = Box3{{15, -5, -5}, {30, 5, 5}}};
  const Outcome cropped = slice(text_of(both), request);
  ASSERT_TRUE(cropped.report) << cropped.report.error().what;
  EXPECT_NEAR(cropped.report->size_mm[0], 4, 0.3);
}

TEST(SliceScan, SamplesTheFacesOfADrawingForPointsWhenAsked) {
  std::string box = "OFF\n8 12 0\n";  // a block of 20 x 12 x 8 mm: eight corners
  for (int i = 0; i < 8; ++i) box += fmt::format("{} {} {}\n", i & 1 ? 20 : 0, i & 2 ? 12 : 0, i & 4 ? 8 : 0);
  for (const char* face :
       {"0 2 3", "0 3 1", "4 5 7", "4 7 6", "0 1 5", "0 5 4", "2 6 7", "2 7 3", "0 4 6", "0 6 2", "1 3 7", "1 7 5"})
    box += fmt::format("3 {}\n", face);
  SliceRequest request = request_for();
  const Outcome plain = slice(box, request);
  ASSERT_FALSE(plain.report);
  EXPECT_NE(plain.report.error().what.find("too few"), std::string::npos) << plain.report.error().what;
  request.intake.sample_faces = true;
  request.layers = {{4, 4}};
  const Outcome sampled = slice(box, request);
  ASSERT_TRUE(sampled.report) << sampled.report.error().what;
  EXPECT_GT(sampled.report->points, 90'000U);
  ASSERT_EQ(sampled.layers[0].contours.size(), 1U);
  EXPECT_NEAR(sampled.layers[0].contours[0].signed_area_mm2(), 240, 3);
  EXPECT_FALSE(slice(ball_text(), request).report) << "there are no faces to sample";
}

TEST(SliceScan, FlagsAScanWhoseCoordinatesAreRounded) {
  std::string text;
  for (const Vec3& p : test::sample_surface(*test::sphere(10, 1), {.spacing_mm = 0.6, .seed = 31}).points)
    text += fmt::format("{} {} {}\n", static_cast<float>(500000 + p.x()), static_cast<float>(5400000 + p.y()),
                        static_cast<float>(120 + p.z()));
  const Outcome outcome = slice(text, request_for());
  ASSERT_TRUE(outcome.report) << outcome.report.error().what;
  EXPECT_EQ(outcome.report->certified, 0U);
  EXPECT_NE(outcome.report->warnings.at(0).find("0.5 in y"), std::string::npos) << outcome.report->warnings[0];
}

TEST(SliceScan, TurnsTheNamedAxisUpWithoutMirroring) {
  // Longest along x, then y, then z; heavier at the positive end of each axis is not needed: the frame is checked.
  const std::string scan = text_of(test::sample_surface(*test::ellipsoid({12, 9, 6}, 1), {.spacing_mm = 0.8}));
  const std::array<std::pair<const char*, double>, 6> heights{
      {{"x", 24}, {"-x", 24}, {"y", 18}, {"-y", 18}, {"z", 12}, {"-z", 12}}};
  for (const auto& [name, height] : heights) {
    SliceRequest request = request_for();
    request.placement.turn = turn_from_up(name).value();
    request.layers = {{5, 5}};
    const Outcome outcome = slice(scan, request);
    ASSERT_TRUE(outcome.report) << name << ": " << outcome.report.error().what;
    EXPECT_NEAR(outcome.report->size_mm[2], height, 0.3) << name;
    const Transform4& t = outcome.report->header.scan_to_build;
    Eigen::Matrix3d turn;
    turn << t[0], t[1], t[2], t[4], t[5], t[6], t[8], t[9], t[10];
    EXPECT_NEAR(turn.determinant(), 1, 1e-12) << name;
    const std::string axis{name};
    const double sign = axis[0] == '-' ? -1 : 1;
    const Vec3 named = sign * Vec3::Unit(axis.back() - 'x');
    EXPECT_TRUE((turn * named).isApprox(Vec3::UnitZ())) << name;
    EXPECT_EQ(outcome.layers[0].contours.size(), 1U);
    EXPECT_FALSE(outcome.layers[0].contours[0].is_hole()) << name;
  }
}

/// A scan whose details are near to, or below, what its samples can show.
struct HardCase {
  const char* name;
  test::Shape shape;
  test::SampleOptions sampling;
  std::optional<double> kernel_mm = {};
};

std::vector<HardCase> hard_cases() {
  std::vector<HardCase> cases;
  cases.push_back({"wall of half a spacing", test::thin_wall(14, 12, 0.4, 0.4), {.spacing_mm = 0.8, .seed = 31}});
  cases.push_back({"gap of half a spacing", test::near_touching_balls(6, 0.3, 0.3), {.spacing_mm = 0.6, .seed = 32}});
  cases.push_back({"bored plate, few samples", test::bored_plate(3, 6, 1, 0.7), {.spacing_mm = 1.6, .seed = 33}});
  cases.push_back({"noisy torus",
                   test::torus(9, 4, 35, 1),
                   {.spacing_mm = 0.6, .noise_mm = 0.3, .normal_noise_rad = 0.15, .seed = 34}});
  cases.push_back({"noisy figure eight",
                   test::genus_two(12, 0.4),
                   {.spacing_mm = 0.4, .noise_mm = 0.2, .normal_noise_rad = 0.15, .seed = 35}});
  cases.push_back({"noisy torus, kernel too narrow for the noise",
                   test::torus(9, 4, 35, 1),
                   {.spacing_mm = 0.4, .noise_mm = 0.2, .normal_noise_rad = 0.15, .seed = 37},
                   0.6});
  return cases;
}

TEST(SliceScan, CertifiesNoWrongLayerOfSparseAndNoisyScans) {
  int certified = 0;
  for (const HardCase& hard : hard_cases()) {
    SliceRequest request = request_for();
    request.machine.platform = {200, 200, 200};
    request.mls.kernel_mm = hard.kernel_mm;
    const Outcome outcome = slice(text_of(test::sample_surface(*hard.shape, hard.sampling)), request);
    ASSERT_TRUE(outcome.report) << hard.name << ": " << outcome.report.error().what;
    const double shift = outcome.report->header.scan_to_build[11];
    const double reach = 0.1 * outcome.report->kernel.kernel_mm;
    for (const Layer& layer : outcome.layers) {
      if (!layer.certificate.is_certified()) continue;
      ++certified;
      test::SliceCount found;
      for (const Contour& ring : layer.contours) ++(ring.is_hole() ? found.holes : found.outers);
      bool right = false;
      for (const double off : {0.0, -0.5, 0.5, -1.0, 1.0})
        right = right || test::count_slice(*hard.shape, layer.z_mm - shift + off * reach, 0.1) == found;
      EXPECT_TRUE(right) << hard.name << " layer " << layer.index.count() << ": " << found.outers << " outer and "
                         << found.holes << " hole contours";
    }
  }
  EXPECT_GT(certified, 50);
}

TEST(SliceScan, HoldsAKernelGivenByHandAgainstOthersWhereTheScanIsNoisy) {
  const auto noisy = test::sample_surface(*test::torus(9, 4, 35, 1),
                                          {.spacing_mm = 0.5, .noise_mm = 0.25, .normal_noise_rad = 0.15, .seed = 38});
  SliceRequest request = request_for();
  request.mls.kernel_mm = 0.6;
  const Outcome outcome = slice(text_of(noisy), request);
  ASSERT_TRUE(outcome.report) << outcome.report.error().what;
  const auto& flagged = outcome.report->flagged;
  EXPECT_TRUE(std::any_of(flagged.begin(), flagged.end(), [](const FlaggedLayer& f) {
    return f.certificate.doubt->reason == DoubtReason::KernelsDisagree && f.certificate.doubt->place;
  }));
}

TEST(SliceScan, CertifiesANoisyScanWhoseDetailsAreLarge) {
  const auto noisy = test::sample_surface(*test::torus(9, 4, 90, 1),
                                          {.spacing_mm = 0.35, .noise_mm = 0.17, .normal_noise_rad = 0.15, .seed = 36});
  const Outcome outcome = slice(text_of(noisy), request_for());
  ASSERT_TRUE(outcome.report) << outcome.report.error().what;
  EXPECT_GT(outcome.report->kernel.noise_mm, 0.3 * outcome.report->kernel.spacing_mm);
  EXPECT_LE(outcome.report->flagged.size(), outcome.layers.size() / 10);
}

TEST(SliceScan, SaysOnceThatTheSpacingOfAScanVariesAndCertifiesOnlyWhatIsRight) {
  auto samples = test::sample_surface(*test::sphere(10, 1), {.spacing_mm = 1.6, .seed = 13});
  const auto dense = test::sample_surface(*test::sphere(10, 1), {.spacing_mm = 0.12, .seed = 14});
  for (std::size_t i = 0; i < dense.points.size(); ++i)
    if (dense.points[i].x() > 9) {
      samples.points.push_back(dense.points[i]);
      samples.normals.push_back(dense.normals[i]);
    }
  const Outcome outcome = slice(text_of(samples), request_for());
  ASSERT_TRUE(outcome.report) << outcome.report.error().what;
  ASSERT_GT(outcome.report->kernel.unevenness, 5);
  EXPECT_EQ(std::count_if(outcome.report->warnings.begin(), outcome.report->warnings.end(),
                          [](const std::string& w) { return w.find("spacing of the scan varies") != w.npos; }),
            1);
  EXPECT_GT(outcome.report->certified, outcome.layers.size() / 4);
  for (const Layer& layer : outcome.layers)
    if (layer.certificate.is_certified()) {
      EXPECT_EQ(layer.contours.size(), 1U) << layer.index.count();
    }
}

TEST(Preview, PaintsAPicture) {
  StackHeader header;
  header.machine = "bench";
  header.layer_thickness_mm = 1;
  header.pixel_pitch_mm = 0.1;
  header.layer_count = 3;
  header.bounds = {{0, 0}, {10, 10}};
  Preview preview{header, LayerIndex{0}, LayerIndex{2}};
  for (std::uint32_t i = 0; i < 3; ++i) {
    Layer layer;
    layer.index = LayerIndex{i};
    layer.z_mm = i + 0.5;
    layer.contours.push_back(*Contour::from_vertices({{1, 1}, {9, 1}, {9, 9}, {1, 9}}));
    preview.add(layer);
  }
  const auto png = preview.png();
  ASSERT_TRUE(png);
  EXPECT_GT(png->size(), 1000U);
}

}  // namespace
}  // namespace telefab::scan
