// SPDX-License-Identifier: GPL-3.0-or-later
#include <gtest/gtest.h>

#include <telefab/scan/contour/layer_checks.hpp>
#include <telefab/scan/contour/specks.hpp>

namespace telefab::scan {
namespace {

/// Counter-clockwise; a hole where it is said to be one.
Contour box(double x, double y, double width, double depth, bool hole = false) {
  std::vector<Point2> v{{x, y}, {x + width, y}, {x + width, y + depth}, {x, y + depth}};
  if (hole) std::reverse(v.begin(), v.end());
  return Contour::from_vertices(std::move(v)).value();
}

Layer certified(std::vector<Contour> rings) {
  Layer layer;
  layer.z_mm = cut_height_mm(layer.index, 0.15);
  layer.contours = std::move(rings);
  layer.certificate.verdict = LayerCertificate::Verdict::Measured;
  for (const Contour& ring : layer.contours) layer.certificate.measured_euler += ring.is_hole() ? -1 : 1;
  return layer;
}

TEST(Specks, AreRingsOfLessAreaThanStatedAndNoOthers) {
  Layer layer = certified({box(0, 0, 10, 10), box(1, 1, 0.09, 0.1, true), box(2, 2, 0.1, 0.1, true),
                           box(20, 0, 0.09, 0.1), box(20, 2, 0.1, 0.11)});
  const Layer whole = layer;
  const LeftOut out = leave_specks_out(layer, {0.00999, 0});
  EXPECT_EQ(out.rings, 2U);
  EXPECT_NEAR(out.largest_mm2, 0.009, 1e-12);
  ASSERT_EQ(layer.contours.size(), 3U);
  EXPECT_EQ(layer.contours[0], whole.contours[0]);
  EXPECT_EQ(layer.contours[1], whole.contours[2]);
  EXPECT_EQ(layer.contours[2], whole.contours[4]);
  // The certificate keeps what was found and says how many of it are gone.
  EXPECT_EQ(layer.certificate.specks, 2U);
  EXPECT_EQ(layer.certificate.measured_euler, whole.certificate.measured_euler);
  EXPECT_TRUE(layer.certificate.is_certified());
}

TEST(Specks, AreThinRingsAndWhatLiesInThem) {
  // A hair of ten millimetres with a knot that is wide enough for a hole of its own.
  const Contour hair = Contour::from_vertices({{0, 0},
                                               {5, 0},
                                               {5, -0.1},
                                               {5.3, -0.1},
                                               {5.3, 0},
                                               {10, 0},
                                               {10, 0.001},
                                               {5.3, 0.001},
                                               {5.3, 0.2},
                                               {5, 0.2},
                                               {5, 0.001},
                                               {0, 0.001}})
                           .value();
  Layer layer = certified({hair, box(5.1, 0, 0.1, 0.1, true), box(0, 1, 10, 0.5)});
  ASSERT_FALSE(find_bad_nesting(layer.contours));
  EXPECT_EQ(leave_specks_out(layer, {0, 0.02}).rings, 2U);
  ASSERT_EQ(layer.contours.size(), 1U);
  EXPECT_FALSE(find_bad_nesting(layer.contours));
  EXPECT_EQ(layer.certificate.specks, 2U);
}

TEST(Specks, LeaveALayerAsItIsThatHasNone) {
  Layer layer = certified({box(0, 0, 10, 10), box(1, 1, 2, 2, true)});
  const Layer whole = layer;
  EXPECT_EQ(leave_specks_out(layer, {0.01, 0.02}).rings, 0U);
  EXPECT_EQ(layer, whole);
}

TEST(Specks, ThatWereAllThatWasCompletedLeaveAMeasuredLayer) {
  StackHeader header;
  header.layer_thickness_mm = 0.15;
  header.pixel_pitch_mm = 0.14;
  header.layer_count = 1;
  header.bounds = {{0, 0}, {40, 40}};
  const SurfaceRun gap{SurfaceClass::Completed, 4, 1.5, 0.3};
  Layer layer = certified({box(0, 0, 10, 10), box(20, 0, 0.05, 0.05).with_runs(std::array{gap}).value()});
  layer.certificate.verdict = LayerCertificate::Verdict::Completed;
  ASSERT_TRUE(validate_layer(header, layer));
  EXPECT_EQ(leave_specks_out(layer, {0.01, 0}).rings, 1U);
  EXPECT_EQ(layer.certificate.verdict, LayerCertificate::Verdict::Measured);
  EXPECT_TRUE(validate_layer(header, layer));
}

TEST(Specks, AreNoReasonToTrustADoubtfulLayer) {
  Layer layer = certified({box(0, 0, 10, 10), box(20, 0, 0.05, 0.05)});
  layer.certificate.flag({.reason = DoubtReason::KernelsDisagree});
  EXPECT_EQ(leave_specks_out(layer, {0.01, 0}).rings, 1U);
  EXPECT_FALSE(layer.certificate.is_certified());
}

TEST(Specks, ThatWereAllOfALayerAreNamedAsTheReasonThatItIsEmpty) {
  Layer layer = certified({box(20, 0, 0.05, 0.05), box(22, 0, 0.05, 0.05)});
  leave_specks_out(layer, {0.01, 0});
  EXPECT_TRUE(layer.contours.empty());
  layer.certificate.flag({.reason = DoubtReason::ContourMissing});
  EXPECT_EQ(sentence_of(layer.certificate), "nothing is left: the 2 contours found are too small to be printed");
}

}  // namespace
}  // namespace telefab::scan
