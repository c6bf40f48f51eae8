// SPDX-License-Identifier: GPL-3.0-or-later
#include <telefab/scan/registration/register_views.hpp>

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <cmath>
#include <telefab/scan/digitize/digitize.hpp>
#include <telefab/scan/registration/merge_views.hpp>
#include <telefab/scan/registration/pose_file.hpp>

#include "lump.hpp"

namespace telefab::scan {
namespace {

Scene scene(const DigitizeOptions& options) { return scene_of(lump_mesh(), options); }

void expect_poses(const Scene& s, const Registration& r, double degrees, double shift_mm) {
  for (std::size_t i = 0; i < s.truth.size(); ++i) {
    const MotionDifference d = difference(r.poses[i], s.truth[i], Vec3::Zero());
    EXPECT_LT(d.degrees, degrees) << "view " << i;
    EXPECT_LT(d.shift, shift_mm) << "view " << i;
  }
}

TEST(RegisterViews, FindsAxisAndPosesOfANoisyTurn) {
  Scene s = scene(
      {.step_deg = 30, .pitch_mm = 0.6, .tilt_deg = 0, .noise_mm = 0.03, .outlier_share = 0.002, .mixed_share = 0.3});
  const auto r = register_views(s.images, {.step_deg = 30, .max_rms = 0.3}, {}, {});
  ASSERT_TRUE(r) << r.error().what;
  expect_poses(s, *r, 0.3, 0.15);
  EXPECT_LT(r->rms, 0.1);
  EXPECT_TRUE(r->closed_turn);
  EXPECT_LT(r->closure.degrees, 1);
  EXPECT_NEAR(std::abs(r->axis.direction.y()), 1, 1e-3);
}

TEST(RegisterViews, StartsFromGivenPoses) {
  Scene s = scene({.step_deg = 45, .pitch_mm = 0.6, .tilt_deg = 20, .noise_mm = 0.02});
  RegisterOptions options{.max_rms = 0.3};
  options.start = s.truth;
  for (std::size_t i = 1; i < options.start.size(); ++i)
    options.start[i] =
        moved_by((Eigen::Matrix<double, 6, 1>() << 0.01, 0.01, -0.01, 0.3, -0.3, 0.2).finished(), options.start[i]);
  const auto r = register_views(s.images, options, {}, {});
  ASSERT_TRUE(r) << r.error().what;
  expect_poses(s, *r, 0.3, 0.15);
}

TEST(RegisterViews, RefusesAWrongStep) {
  Scene s = scene({.step_deg = 30, .pitch_mm = 0.6, .tilt_deg = 0, .noise_mm = 0.03});
  const auto r = register_views(s.images, {.step_deg = 72, .max_rms = 0.3}, {}, {});
  ASSERT_FALSE(r) << "rms " << r->rms << " conflict " << r->conflict;
  EXPECT_EQ(r.error().code, ErrorCode::NotConverged);
}

TEST(RegisterViews, RefusesMoreErrorThanTheBudget) {
  Scene s = scene({.step_deg = 30, .pitch_mm = 0.6, .tilt_deg = 0, .noise_mm = 0.2});
  const auto r = register_views(s.images, {.step_deg = 30, .axis_direction = Vec3::UnitY(), .max_rms = 0.05}, {}, {});
  ASSERT_FALSE(r);
  EXPECT_THAT(r.error().what, testing::HasSubstr("budget"));
}

TEST(RegisterViews, RefusesOptionsThatMakeNoSense) {
  EXPECT_FALSE((RegisterOptions{.step_deg = 30, .max_rms = 1}.validate(1)));
  EXPECT_FALSE((RegisterOptions{.step_deg = 0, .max_rms = 1}.validate(3)));
  EXPECT_FALSE((RegisterOptions{.step_deg = 30, .max_rms = 0}.validate(3)));
  EXPECT_FALSE((RegisterOptions{.step_deg = 30, .axis_direction = Vec3::Zero(), .max_rms = 1}.validate(3)));
  EXPECT_TRUE((RegisterOptions{.step_deg = 30, .max_rms = 1}.validate(3)));
}

TEST(MergeViews, MakesOneCloudOnTheSurfaceFacingOutward) {
  Scene s = scene({.step_deg = 45, .pitch_mm = 0.8, .tilt_deg = 0, .noise_mm = 0.05, .outlier_share = 0.002});
  RegisterOptions options{.step_deg = 45, .max_rms = 0.3};
  options.start = s.truth;
  const auto r = register_views(s.images, options, {}, {});
  ASSERT_TRUE(r) << r.error().what;
  const auto merged = merge_views(s.images, r->poses, {}, {});
  ASSERT_TRUE(merged) << merged.error().what;
  ASSERT_GT(merged->cloud.size(), 2000U);
  EXPECT_LT(merged->cloud.size(), merged->report.points_in);
  Vec3 middle = Vec3::Zero();
  for (const auto& p : merged->cloud.points) middle += p.cast<double>() / static_cast<double>(merged->cloud.size());
  std::size_t outward = 0;
  for (std::size_t i = 0; i < merged->cloud.size(); ++i)
    outward +=
        (merged->cloud.points[i].cast<double>() - middle).dot(merged->cloud.normals[i].cast<double>()) > 0 ? 1 : 0;
  EXPECT_GT(static_cast<double>(outward), 0.98 * static_cast<double>(merged->cloud.size()));
  const auto cut = merge_views(s.images, r->poses, {.cut_below = 10}, {});
  ASSERT_TRUE(cut);
  EXPECT_GT(cut->report.stand_points, 100U);
}

TEST(Align, BringsAMovedCloudBack) {
  Scene s = scene({.step_deg = 360, .views = 1, .pitch_mm = 0.8, .tilt_deg = 0});
  const RangeImage& image = s.images.front();
  const AlignTarget target{image.points, image.normals};
  const RigidMotion moved =
      moved_by((Eigen::Matrix<double, 6, 1>() << 0.05, -0.04, 0.03, 1, -1, 0.5).finished(), RigidMotion::Identity());
  const auto back = align(image.points, image.normals, target, moved, {.first_distance = 5, .last_distance = 1}, {});
  ASSERT_TRUE(back) << back.error().what;
  EXPECT_LT(difference(back->motion, RigidMotion::Identity(), Vec3::Zero()).degrees, 0.02);
  EXPECT_LT(back->rms, 0.01);
}

TEST(PoseFile, ReadsBackWhatItWrites) {
  const RigidMotion pose =
      moved_by((Eigen::Matrix<double, 6, 1>() << 0.3, -0.2, 1.1, 4, 5, -6).finished(), RigidMotion::Identity());
  const std::vector<NamedPose> poses{{"a.ply", pose}};
  const auto back = read_pose_file("camera 0 0 0 0 1 0 0\n" + to_pose_file(poses));
  ASSERT_TRUE(back);
  ASSERT_EQ(back->size(), 1U);
  EXPECT_TRUE(back->front().pose.isApprox(pose, 1e-7));
  EXPECT_FALSE(read_pose_file("bmesh a.ply 1 2 three 0 0 0 1\n"));
  EXPECT_FALSE(read_pose_file(""));
}

TEST(Digitize, IsTheSameForTheSameSeed) {
  const DigitizeOptions options{.step_deg = 120, .pitch_mm = 2, .noise_mm = 0.1, .outlier_share = 0.01};
  const auto a = digitize(lump_mesh(), options, {}), b = digitize(lump_mesh(), options, {});
  ASSERT_TRUE(a && b);
  ASSERT_EQ(a->size(), 3U);
  EXPECT_EQ(a->at(1).points, b->at(1).points);
}

TEST(Digitize, PutsPointsOnTheModel) {
  const auto views = digitize(lump_mesh(), {.step_deg = 90, .pitch_mm = 1, .tilt_deg = 30}, {});
  ASSERT_TRUE(views);
  std::vector<Eigen::Vector3f> vertices;
  for (const Vec3& p : lump_mesh().points) vertices.push_back(p.cast<float>());
  const KdTree tree{vertices};
  for (const VirtualView& v : *views) {
    ASSERT_GT(v.points.size(), 500U);
    for (const auto& p : v.points)
      EXPECT_LT(tree.nearest((v.scanner_to_model * p.cast<double>()).cast<float>()).squared_distance, 2.25F);
  }
  EXPECT_FALSE(digitize({}, {}, {}));
  EXPECT_FALSE(digitize(lump_mesh(), {.pitch_mm = 1e-5}, {})) << "an image too large to hold";
}

}  // namespace
}  // namespace telefab::scan
