#include <telefab/scan/pipeline/slice_scan.hpp>

#include <fmt/format.h>
#include <gtest/gtest.h>

#include <numbers>
#include <telefab/scan/pipeline/preview.hpp>
#include <telefab/test/analytic_field.hpp>
#include <telefab/test/surface_samples.hpp>

namespace telefab::scan {
namespace {

MachineProfile machine() {
  MachineProfile m;
  m.name = "bench";
  m.platform = {60, 40, 50};
  m.projection.pixel_pitch_mm = 0.1;
  m.layers.thickness_mm = 0.5;
  return m;
}

/// A text scan: x y z nx ny nz, one point a line.
std::string text_of(const test::SurfaceSamples& samples) {
  std::string text;
  for (std::size_t i = 0; i < samples.points.size(); ++i) {
    const Vec3& p = samples.points[i];
    const Vec3& n = samples.normals[i];
    text += fmt::format("{} {} {} {} {} {}\n", p.x(), p.y(), p.z(), n.x(), n.y(), n.z());
  }
  return text;
}

const std::string& torus_text() {
  static const std::string text =
      text_of(test::sample_surface(*test::torus(9, 4, 90, 1, {100, 200, -300}), {.spacing_mm = 0.7, .seed = 11}));
  return text;
}

struct Outcome {
  Result<SliceReport> report;
  std::vector<Layer> layers;
  std::string text;  ///< canonical
};

Outcome slice(const std::string& scan, const SliceRequest& request, std::stop_token stop = {}) {
  Outcome outcome;
  const LayerSink sink = [&](const StackHeader& header, Layer&& layer) -> Result<void> {
    EXPECT_TRUE(validate_layer(header, layer));
    outcome.text += canonical_text(layer);
    outcome.layers.push_back(std::move(layer));
    return {};
  };
  outcome.report = slice_scan(std::as_bytes(std::span{scan}), "torus.xyz", request, sink, {}, stop);
  return outcome;
}

SliceRequest request_for(unsigned threads = 2) {
  SliceRequest request;
  request.machine = machine();
  request.threads = threads;
  return request;
}

TEST(SliceScan, CertifiesEveryLayerOfATorusWithTheRightRings) {
  const Outcome outcome = slice(torus_text(), request_for());
  ASSERT_TRUE(outcome.report) << outcome.report.error().what;
  EXPECT_EQ(outcome.layers.size(), 52U);
  EXPECT_EQ(outcome.report->surface_euler, 0);
  EXPECT_TRUE(outcome.report->flagged.empty()) << outcome.report->flagged[0].reason;
  for (const Layer& layer : outcome.layers) {
    EXPECT_EQ(layer.certificate.verdict, LayerCertificate::Verdict::Certified);
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
    double a = 0, b = 0;
    for (const Contour& c : by_grid.layers[i].contours) a += c.signed_area_mm2();
    for (const Contour& c : marched.layers[i].contours) b += c.signed_area_mm2();
    EXPECT_NEAR(a, b, 0.002 * std::abs(b) + 0.01) << "layer " << i;
  }
}

TEST(SliceScan, ScalesToHeightAndToFit) {
  SliceRequest request = request_for();
  request.height_mm = 13;
  const Outcome small = slice(torus_text(), request);
  ASSERT_TRUE(small.report);
  EXPECT_NEAR(small.report->size_mm[2], 13, 1e-4);
  EXPECT_EQ(small.layers.size(), 26U);
  request.height_mm.reset();
  request.fit = true;
  request.layers = {{10, 10}};
  const Outcome large = slice(torus_text(), request);
  ASSERT_TRUE(large.report) << large.report.error().what;
  EXPECT_NEAR(large.report->size_mm[1], 40, 0.01);  // the depth is what limits it
  EXPECT_LE(large.report->size_mm[0], 60);
}

TEST(SliceScan, RefusesAPartLargerThanTheMachineNamingBothSizes) {
  SliceRequest request = request_for();
  request.height_mm = 80;
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
  two.height_mm = 10;
  two.fit = true;
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

TEST(SliceScan, FlagsAScanWithAGapInsteadOfGuessing) {
  const auto torn =
      test::sample_surface(*test::sphere(10, 1), {.spacing_mm = 0.7, .holes = {{{10, 0, 0}, 4}}, .seed = 12});
  const Outcome outcome = slice(text_of(torn), request_for());
  ASSERT_TRUE(outcome.report) << outcome.report.error().what;
  EXPECT_FALSE(outcome.report->flagged.empty());
  for (const Layer& layer : outcome.layers)
    if (std::abs(layer.z_mm - 10) < 2.5) {
      EXPECT_EQ(layer.certificate.verdict, LayerCertificate::Verdict::Flagged) << layer.z_mm;
      EXPECT_FALSE(layer.certificate.reason.empty());
      EXPECT_TRUE(layer.certificate.place);
    }
}

TEST(SliceScan, CertifiesNothingWhereWallsMayLieBetweenThePoints) {
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
  EXPECT_EQ(outcome.report->certified, 0U);
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
