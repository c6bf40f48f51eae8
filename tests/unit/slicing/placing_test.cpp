// SPDX-License-Identifier: GPL-3.0-or-later
// How a scan is made to stand: turned, mirrored, scaled by axis, moved.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <Eigen/Dense>
#include <cmath>
#include <telefab/scan/slicing/placement.hpp>

#include "sliced.hpp"

namespace telefab::scan {
namespace {

using testing::HasSubstr;

/// An L of three boxes' corners would do for places; normals are those of the faces they stand on, unlike each other.
PointCloud corners() {
  PointCloud cloud;
  cloud.origin = {100, -20, 7};
  for (const double x : {0, 4})
    for (const double y : {0, 3})
      for (const double z : {0, 2}) {
        cloud.points.push_back(Eigen::Vector3d{x, y, z}.cast<float>());
        cloud.normals.push_back(Eigen::Vector3d{x - 2, y - 1.5, z - 1}.normalized().cast<float>());
      }
  return cloud;
}

Eigen::Matrix3d linear_of(const Transform4& t) {
  Eigen::Matrix3d m;
  m << t[0], t[1], t[2], t[4], t[5], t[6], t[8], t[9], t[10];
  return m;
}

Vec3 through(const Transform4& t, const Vec3& p) { return linear_of(t) * p + Vec3{t[3], t[7], t[11]}; }

TEST(Placement, TransformSaysWhereEveryPointOfTheScanWent) {
  const PointCloud scan = corners();
  SliceRequest request = request_for();
  request.placement.scale = 2;
  request.placement.turn = turn_from_rotate("30,-20,50").value();
  request.placement.mirror = MirrorAxis::Y;
  request.placement.axis_scale = {1.1, 0.9, 1.05};
  request.placement.position_mm = Point2{20, 15};
  const auto placed = place_on_platform(scan, request);
  ASSERT_TRUE(placed) << placed.error().what;
  Box3 box = Box3::nothing();
  for (std::size_t i = 0; i < scan.size(); ++i) {
    const Vec3 here = placed->cloud.origin + placed->cloud.points[i].cast<double>();
    EXPECT_LT((through(placed->scan_to_build, scan.origin + scan.points[i].cast<double>()) - here).norm(), 1e-5);
    box.include(here);
  }
  EXPECT_LT((box.middle() - Vec3{20, 15, box.size().z() / 2}).norm(), 1e-5);
  EXPECT_LT((box.size() - placed->size_mm).norm(), 1e-5);
  EXPECT_NEAR(linear_of(placed->scan_to_build).determinant(), -8 * 1.1 * 0.9 * 1.05, 1e-9);
}

TEST(Placement, HeightAskedForIsTheOneBeforeShrinkage) {
  SliceRequest request = request_for();
  request.placement.height_mm = 10;
  request.placement.axis_scale = {1.02, 1.02, 1.01};
  const auto placed = place_on_platform(corners(), request);
  ASSERT_TRUE(placed) << placed.error().what;
  EXPECT_NEAR(placed->size_mm.z(), 10.1, 1e-9);
  EXPECT_NEAR(placed->size_mm.x(), 20.4, 1e-9);
}

TEST(Placement, IsMadeLargerByWhatTheResinShrinksSoThatThePrintHasTheSizeAskedFor) {
  SliceRequest request = request_for();
  request.machine.resin.shrink_x_percent = 2;
  request.machine.resin.shrink_y_percent = 1;
  request.machine.resin.shrink_z_percent = 4;
  request.placement.height_mm = 10;
  const auto placed = place_on_platform(corners(), request);
  ASSERT_TRUE(placed) << placed.error().what;
  EXPECT_NEAR(placed->size_mm.x() * 0.98, 20, 1e-9);
  EXPECT_NEAR(placed->size_mm.y() * 0.99, 15, 1e-9);
  EXPECT_NEAR(placed->size_mm.z() * 0.96, 10, 1e-9);
  EXPECT_THAT(sentence_of(placed->options), HasSubstr("1.02041, 1.0101 and 1.04167 along x, y and z"));
  // A scale of the user's own comes on top; the frame is the platform's, whichever way the scan was turned.
  request.placement.axis_scale = {1.1, 1, 1};
  request.placement.turn = turn_from_rotate("0,0,90").value();
  const auto turned = place_on_platform(corners(), request);
  ASSERT_TRUE(turned) << turned.error().what;
  EXPECT_NEAR(turned->size_mm.x() * 0.98, 15 * 1.1, 1e-6);
  EXPECT_NEAR(turned->size_mm.z() * 0.96, 10, 1e-6);
}

// A sphere that is made longer is an ellipsoid, whose normals do not follow its points.
TEST(Placement, NormalsStaySquareToTheSurfaceAndOutward) {
  PointCloud ball;
  for (int i = 0; i < 400; ++i) {
    const double z = 1 - (2 * i + 1) / 400.0, turn = 2.39996 * i, flat = std::sqrt(1 - z * z);
    const Eigen::Vector3f n = Eigen::Vector3d{flat * std::cos(turn), flat * std::sin(turn), z}.cast<float>();
    ball.points.push_back(5 * n);
    ball.normals.push_back(n);
  }
  SliceRequest request = request_for();
  request.placement.scale = 1;
  request.placement.axis_scale = {1.25, 0.8, 1};
  request.placement.mirror = MirrorAxis::Z;
  request.placement.turn = turn_from_up("1,2,3").value();
  const auto placed = place_on_platform(ball, request);
  ASSERT_TRUE(placed);
  const Vec3 half = placed->size_mm / 2;
  for (std::size_t i = 0; i < ball.size(); ++i) {
    const Vec3 from_middle = placed->cloud.points[i].cast<double>();
    const Vec3 wanted = from_middle.cwiseQuotient(half.cwiseProduct(half)).normalized();
    EXPECT_GT(wanted.dot(placed->cloud.normals[i].cast<double>()), 0.9995) << i;
  }
}

TEST(Placement, PositionOffThePlatformIsRefusedWithTheRoomThereIs) {
  SliceRequest request = request_for();
  request.placement.scale = 5;  // 20 x 15 mm on 60 x 40
  const auto at = [&](double x, double y) {
    request.placement.position_mm = Point2{x, y};
    const auto placed = place_on_platform(corners(), request);
    return placed ? std::string{"placed"} : placed.error().what;
  };
  EXPECT_EQ(at(10, 7.5), "placed");
  EXPECT_EQ(at(50, 32.5), "placed");
  EXPECT_THAT(at(9.9, 20), HasSubstr("room for x from 10.00 to 50.00 and y from 7.50 to 32.50"));
  EXPECT_THAT(at(30, 33), HasSubstr("at 30,33"));
}

TEST(Placement, FactorsFarFromOneAreRefused) {
  PlacementOptions options;
  options.axis_scale = axis_scale_from("1,1,1.3").value();
  EXPECT_THAT(options.validate().error().what, HasSubstr("0.8 to 1.25"));
  EXPECT_THAT(axis_scale_from("1.1").error().what, HasSubstr("three factors"));
  EXPECT_THAT(position_from("1,2,3").error().what, HasSubstr("X,Y"));
  EXPECT_THAT(mirror_axis_from("xy").error().what, HasSubstr("x, y, z"));
}

double area_of(const Layer& layer) {
  double area = 0;
  for (const Contour& c : layer.contours) area += c.signed_area_mm2();
  return area;
}

/// A body without any symmetry, turned by the inverse of `turn` as a file holds it.
std::string lopsided(const Turn& turn, double x_sign = 1) {
  auto samples = test::sample_surface(*test::ellipsoid({12, 7, 6}, 1), {.spacing_mm = 0.8, .seed = 3});
  for (std::size_t i = 0; i < samples.points.size(); ++i) {
    Vec3 p = samples.points[i], n = samples.normals[i];
    // Sheared smoothly, so that no direction is like another.
    p = Vec3{p.x() + 0.03 * p.y() * p.y(), p.y() + 0.4 * p.z(), p.z()};
    n = Vec3{n.x(), n.y() - 0.06 * samples.points[i].y() * n.x(),
             n.z() - 0.4 * (n.y() - 0.06 * samples.points[i].y() * n.x())};
    p.x() *= x_sign;
    n.x() *= x_sign;
    samples.points[i] = turn.matrix().transpose() * p;
    samples.normals[i] = (turn.matrix().transpose() * n).normalized();
  }
  return text_of(samples);
}

TEST(SliceScan, AScanTurnedBackGivesTheLayersOfTheOneThatLay) {
  const Turn turn = turn_from_rotate("25,-40,70").value();
  const Outcome lay = slice(lopsided(Turn{}), request_for());
  SliceRequest request = request_for();
  request.placement.turn = turn;
  const Outcome turned = slice(lopsided(turn), request);
  ASSERT_TRUE(lay.report && turned.report) << turned.report.error().what;
  ASSERT_EQ(turned.layers.size(), lay.layers.size());
  for (std::size_t i = 0; i < lay.layers.size(); ++i) {
    EXPECT_EQ(turned.layers[i].contours.size(), lay.layers[i].contours.size()) << i;
    EXPECT_NEAR(area_of(turned.layers[i]), area_of(lay.layers[i]), 0.02 + 1e-3 * area_of(lay.layers[i])) << i;
  }
}

TEST(SliceScan, MirrorGivesTheOtherHandAndCertifiesIt) {
  const Outcome right = slice(lopsided(Turn{}), request_for());
  SliceRequest request = request_for();
  request.placement.mirror = MirrorAxis::X;
  const Outcome back = slice(lopsided(Turn{}, -1), request);
  ASSERT_TRUE(right.report && back.report) << back.report.error().what;
  EXPECT_EQ(back.report->certified, right.report->certified);
  EXPECT_LT(linear_of(back.report->header.scan_to_build).determinant(), 0);
  ASSERT_EQ(back.layers.size(), right.layers.size());
  for (std::size_t i = 0; i < right.layers.size(); ++i)
    EXPECT_NEAR(area_of(back.layers[i]), area_of(right.layers[i]), 0.02 + 1e-3 * area_of(right.layers[i])) << i;
}

// Points that the surface drops as strays were once found by a box along the axes of the file.
TEST(SliceScan, StraysSetTheSizeOfATurnedScanNeither) {
  std::string scan = torus_text();
  SliceRequest request = request_for();
  request.placement.turn = turn_from_rotate("0,35,20").value();
  const Outcome clean = slice(scan, request);
  for (const char* stray : {"104 190.9 -299 0 0 1\n", "104.4 190.4 -299 0 0 1\n"}) scan += stray;
  const Outcome strayed = slice(scan, request);
  ASSERT_TRUE(clean.report && strayed.report) << strayed.report.error().what;
  for (std::size_t axis = 0; axis < 3; ++axis)
    EXPECT_NEAR(strayed.report->size_mm[axis], clean.report->size_mm[axis], 0.7) << axis;
}

TEST(SliceReport, SaysHowTheScanWasMadeToStand) {
  PlacementOptions options;
  EXPECT_EQ(sentence_of(options), "");
  options.turn = turn_from_rotate("90,0,-45").value();
  options.mirror = MirrorAxis::Z;
  options.axis_scale = {1.02, 1.02, 1.01};
  options.position_mm = Point2{40, 30};
  EXPECT_EQ(
      sentence_of(options),
      "mirrored in z, turned by 90,0,-45 degrees about the axes of the scan, larger by 1.02, 1.02 and 1.01 along x, "
      "y and z, its middle at 40, 30 mm");
  EXPECT_EQ(to_json(options),
            R"({"rotate":"90,0,-45","mirror":"z","scale_axes":[1.02,1.02,1.01],"position_mm":[40.0,30.0]})");
}

}  // namespace
}  // namespace telefab::scan
