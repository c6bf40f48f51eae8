// SPDX-License-Identifier: GPL-3.0-or-later
#include <gtest/gtest.h>

#include <telefab/test/surface_samples.hpp>

namespace telefab::test {
namespace {

std::vector<Shape> every_shape() {
  std::vector<Shape> shapes;
  shapes.push_back(sphere(20, 1));
  shapes.push_back(ellipsoid({12, 18, 30}, 1, Pose::turned(40, Vec3{1, 2, 3})));
  shapes.push_back(torus(20, 8, 90, 1));
  shapes.push_back(torus(20, 8, 30, 1, {3, 4, 5}));
  shapes.push_back(genus_two(20, 1));
  shapes.push_back(two_bumps(20, 1));
  shapes.push_back(thin_wall(30, 40, 3, 1));
  shapes.push_back(near_touching_balls(15, 1.5, 1));
  shapes.push_back(flat_box({12, 14, 10}, 2, 1));
  shapes.push_back(stepped_box(40, 2, 1));
  shapes.push_back(bored_plate(3, 5, 1, 1));
  shapes.push_back(hollow_sphere(20, 5, 1));
  shapes.push_back(bowl(20, 5, 1));
  shapes.push_back(gyroid_ball(20, 16, 1));
  shapes.push_back(bumpy(20, 1));
  return shapes;
}

TEST(AnalyticField, GradientIsTheDerivativeOfTheValue) {
  for (const Shape& shape : every_shape()) {
    const auto cursor = shape->cursor();
    const SurfaceSamples samples = sample_surface(*shape, {.spacing_mm = 6, .seed = 3});
    ASSERT_GT(samples.points.size(), 20u) << shape->facts().name;
    for (const Vec3& on : samples.points) {
      const Vec3 p = on + Vec3(0.05, 0.03, -0.04);
      const scan::FieldSample f = cursor->at(p);
      ASSERT_TRUE(f.in_reach);
      for (int axis = 0; axis < 3; ++axis) {
        const Vec3 step = 1e-5 * Vec3::Unit(axis);
        const double slope = (cursor->at(p + step).value_mm - cursor->at(p - step).value_mm) / 2e-5;
        EXPECT_NEAR(slope, f.gradient[axis], 2e-4) << shape->facts().name << " at " << p.transpose();
      }
    }
  }
}

TEST(AnalyticField, SliceCountsFollowTheFacts) {
  EXPECT_EQ(count_slice(*sphere(20, 1), 3, 0.4), (SliceCount{1, 0}));
  EXPECT_EQ(count_slice(*torus(20, 8, 90, 1), 1, 0.4), (SliceCount{2, 0}));
  EXPECT_EQ(count_slice(*torus(20, 8, 0, 1), 1, 0.4), (SliceCount{1, 1}));
  EXPECT_EQ(count_slice(*bored_plate(3, 5, 1, 1), 0.1, 0.4), (SliceCount{1, 3}));
  EXPECT_EQ(count_slice(*near_touching_balls(15, 1.5, 1), 0, 0.2), (SliceCount{2, 0}));
  EXPECT_EQ(count_slice(*hollow_sphere(20, 5, 1), 0, 0.4), (SliceCount{1, 1}));
  EXPECT_EQ(count_slice(*sphere(20, 1), 25, 0.4), (SliceCount{0, 0}));
}

TEST(SurfaceSamples, LieOnTheSurfaceAtTheAskedSpacing) {
  const Shape ball = sphere(20, 1);
  const SurfaceSamples samples = sample_surface(*ball, {.spacing_mm = 1, .seed = 5});
  EXPECT_NEAR(samples.area_mm2 / (4 * 3.14159265 * 400), 1, 0.1);
  for (std::size_t i = 0; i < samples.points.size(); ++i) {
    EXPECT_NEAR(samples.points[i].norm(), 20, 1e-8);
    EXPECT_NEAR(samples.normals[i].dot(samples.points[i]), 20, 1e-6);
  }
}

TEST(SurfaceSamples, SameSeedSameSamplesOtherSeedOthers) {
  const Shape shape = bumpy(20, 1);
  const SampleOptions options{
      .spacing_mm = 2, .noise_mm = 0.1, .normal_noise_rad = 0.1, .outlier_share = 0.01, .seed = 9};
  SampleOptions other = options;
  other.seed = 10;
  EXPECT_EQ(sample_surface(*shape, options).points, sample_surface(*shape, options).points);
  EXPECT_NE(sample_surface(*shape, options).points, sample_surface(*shape, other).points);
}

TEST(SurfaceSamples, LeaveHolesEmpty) {
  const Shape ball = sphere(20, 1);
  const Hole hole{{0, 0, 20}, 5};
  for (const Vec3& p : sample_surface(*ball, {.spacing_mm = 1, .holes = {hole}, .seed = 5}).points)
    EXPECT_GE((p - hole.centre_mm).norm(), 5);
}

}  // namespace
}  // namespace telefab::test
