// SPDX-License-Identifier: GPL-3.0-or-later
#include <telefab/scan/measure/measure.hpp>

#include <gtest/gtest.h>
#include <cmath>
#include <numbers>
#include <telefab/scan/measure/point_picture.hpp>

namespace telefab::scan {
namespace {

/// Points of an ellipsoid-like body with half axes a, b, c mm, evenly along a spiral; normals of the quadric.
PointCloud body(double a, double b, double c, int count = 6000) {
  PointCloud cloud;
  for (int i = 0; i < count; ++i) {
    const double z = 1 - 2 * (i + 0.5) / count, phi = i * std::numbers::pi * (3 - std::sqrt(5.0)),
                 r = std::sqrt(1 - z * z);
    const Vec3 u{r * std::cos(phi), r * std::sin(phi), z};
    const double bump = 1 + 0.1 * std::sin(3 * phi) * r * r * r + 0.08 * z * z * z;
    cloud.points.push_back(Vec3{a * bump * u.x(), b * bump * u.y(), c * bump * u.z()}.cast<float>());
    cloud.normals.push_back(Vec3{u.x() / a, u.y() / b, u.z() / c}.normalized().cast<float>());
  }
  return cloud;
}

PointCloud moved(PointCloud cloud, const RigidMotion& by) {
  for (auto& p : cloud.points) p = (by * p.cast<double>()).cast<float>();
  for (auto& n : cloud.normals) n = (by.rotation() * n.cast<double>()).cast<float>();
  return cloud;
}

PointCloud grown(PointCloud cloud, float by) {
  for (std::size_t i = 0; i < cloud.size(); ++i) cloud.points[i] += by * cloud.normals[i];
  return cloud;
}

TEST(Measure, FindsNoDeviationOfACloudFromItself) {
  const auto m = measure(body(20, 14, 30), body(20, 14, 30), {}, {});
  ASSERT_TRUE(m) << m.error().what;
  EXPECT_LT(m->deviation.rms, 1e-4);
  EXPECT_EQ(m->unmatched, 0U);
  EXPECT_NEAR(m->height, 60, 2.5);
}

TEST(Measure, SaysTooMuchWithAPlusAndTooLittleWithAMinus) {
  const PointCloud reference = body(20, 14, 30);
  const auto thick = measure(reference, grown(reference, 0.2F), {.align_first = false}, {});
  const auto thin = measure(reference, grown(reference, -0.1F), {.align_first = false}, {});
  ASSERT_TRUE(thick && thin);
  EXPECT_NEAR(thick->deviation.bias, 0.2, 0.01);
  EXPECT_NEAR(thin->deviation.bias, -0.1, 0.01);
  EXPECT_NEAR(thick->deviation.p99, 0.2, 0.02);
  EXPECT_NEAR(thin->deviation.size_mean, 0.1, 0.01);
  EXPECT_NEAR(thin->deviation.size_p95, 0.1, 0.02);
  EXPECT_EQ(thin->deviation.size_max, std::max(-thin->deviation.min, thin->deviation.max));
}

TEST(Measure, UndoesARigidMotionHoweverLarge) {
  const PointCloud reference = body(20, 14, 30);
  RigidMotion by = RigidMotion::Identity();
  by.linear() = Eigen::AngleAxisd{2.2, Vec3{0.3, 1, -0.2}.normalized()}.toRotationMatrix();
  by.translation() = Vec3{100, -50, 20};
  const auto m = measure(reference, moved(reference, by), {}, {});
  ASSERT_TRUE(m) << m.error().what;
  EXPECT_LT(m->deviation.rms, 0.02);
  EXPECT_LT(difference(m->motion * by, RigidMotion::Identity(), Vec3::Zero()).degrees, 0.1);
}

TEST(Measure, CountsWhatHasNoCounterpart) {
  PointCloud built = body(20, 14, 30);
  for (int i = 0; i < 50; ++i) {
    built.points.emplace_back(100.F, static_cast<float>(i), 0.F);
    built.normals.emplace_back(Eigen::Vector3f::UnitX());
  }
  const auto m = measure(body(20, 14, 30), built, {.align_first = false}, {});
  ASSERT_TRUE(m);
  EXPECT_EQ(m->unmatched, 50U);
  EXPECT_TRUE(std::isnan(m->distance.back()));
  EXPECT_EQ(heat_colours(*m, 0.1).back(), (PointColour{110, 110, 110}));
}

TEST(Measure, RefusesCloudsWithoutNormals) {
  PointCloud bare = body(20, 14, 30);
  bare.normals.clear();
  EXPECT_EQ(measure(body(20, 14, 30), bare, {}, {}).error().code, ErrorCode::InvalidInput);
  EXPECT_FALSE((MeasureOptions{.height = -1.0}.validate()));
}

TEST(HeatColours, RunFromBlueOverGreyToOrange) {
  Measurement m;
  m.distance = {-1, 0, 1};
  const auto colours = heat_colours(m, 0.5);
  EXPECT_EQ(colours[0], (PointColour{33, 102, 172}));
  EXPECT_EQ(colours[1], (PointColour{190, 190, 186}));
  EXPECT_EQ(colours[2], (PointColour{213, 94, 0}));
}

TEST(PointPicture, ShowsTheCloudAndHidesWhatLiesBehind) {
  PointCloud two;
  two.points = {{0, -1, 0}, {0, 1, 0}, {1, 0, 1}, {-1, 0, -1}};
  const std::vector<PointColour> colours{{255, 0, 0}, {0, 255, 0}, {0, 0, 0}, {0, 0, 0}};
  const Image image = draw_points(two, colours, {.side_px = 64, .splat_px = 2});
  ASSERT_EQ(image.width_px, 128U);
  const auto pixel = [&](std::size_t x, std::size_t y) { return image.pixels[3 * (y * 128 + x)]; };
  EXPECT_EQ(pixel(32, 31), 255) << "from the front the near point is red";
  EXPECT_EQ(pixel(32, 64 + 31), 0) << "from the back the green one hides it";
}

}  // namespace
}  // namespace telefab::scan
