// SPDX-License-Identifier: GPL-3.0-or-later
#include <telefab/scan/registration/doubled_sheets.hpp>

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <oneapi/tbb/global_control.h>
#include <telefab/scan/registration/merge_views.hpp>

#include "lump.hpp"

namespace telefab::scan {
namespace {

constexpr double kPitch = 0.6;

Scene turn_with_noise(double noise_mm) {
  Scene s = scene_of(lump_mesh(),
                     {.step_deg = 60, .pitch_mm = kPitch, .tilt_deg = 0, .noise_mm = noise_mm, .mixed_share = 0.3});
  // The lump's grid runs the other way about: register_views would find that out.
  for (RangeImage& image : s.images) face_away(image);
  return s;
}

/// A view is moved along its sight.
std::vector<RigidMotion> moved(const Scene& s, std::size_t view, double shift_mm) {
  std::vector<RigidMotion> poses = s.truth;
  const Vec3 sight = poses[view].rotation() * s.images[view].projection->towards_scanner;
  poses[view] = Eigen::Translation3d{shift_mm * sight} * poses[view];
  return poses;
}

/// Bends a view: no motion makes it fit again.
void bend(RangeImage& view, double by) {
  for (Eigen::Vector3f& p : view.points) p.z() += static_cast<float>(by) * (p.x() * p.x() / 400 - 1);
}

TEST(DoubledSheets, AreNotFoundWhereEveryViewShowsTheSameSurfaceWhateverTheNoise) {
  for (const double noise : {0.0, 0.1, 0.6}) {
    const Scene s = turn_with_noise(noise * kPitch);
    const auto found = find_doubled_sheets(s.images, s.truth, {});
    ASSERT_TRUE(found) << found.error().what;
    EXPECT_TRUE(found->empty()) << noise << ": " << sentence_of(found->pairs[0], s.images);
    EXPECT_GE(found->shared.size(), 6U) << "neighbours see something in common";
  }
}

TEST(DoubledSheets, AreNamedWithViewsDistanceAndShareFromOneSpacingAtAnyNoise) {
  for (const double noise : {0.1, 0.6})
    for (const double shift : {1.0, 3.0}) {
      const Scene s = turn_with_noise(noise * kPitch);
      const auto found = find_doubled_sheets(s.images, moved(s, 2, shift * kPitch), {});
      ASSERT_TRUE(found) << found.error().what;
      ASSERT_FALSE(found->empty()) << noise << ", moved " << shift;
      for (const DoubledPair& pair : found->pairs) {
        EXPECT_TRUE(pair.first == 2 || pair.second == 2) << pair.first << ", " << pair.second;
        EXPECT_LT(pair.apart, 1.2 * shift * kPitch + noise * kPitch);
        EXPECT_GT(pair.apart, 0.3 * shift * kPitch);
      }
      EXPECT_GT(found->pairs.front().share, 0.3);
      std::size_t marked = 0;
      for (const float apart : found->apart[2]) marked += apart > 0 ? 1 : 0;
      EXPECT_GT(marked, 200U);
      EXPECT_THAT(sentence_of(found->pairs[0], s.images), testing::HasSubstr("view_2"));
    }
}

TEST(DoubledSheets, AreBroughtTogetherWhereAPoseWasWrong) {
  const Scene s = turn_with_noise(0.06);
  std::vector<RigidMotion> poses = moved(s, 2, 2 * kPitch);
  const auto reconciled = reconcile_doubled_sheets(s.images, poses, {});
  ASSERT_TRUE(reconciled) << reconciled.error().what;
  EXPECT_TRUE(reconciled->empty());
  for (std::size_t i = 0; i < poses.size(); ++i)
    EXPECT_LT(difference(poses[i], s.truth[i], Vec3::Zero()).shift, 0.2) << i;
}

TEST(DoubledSheets, StayMarkedInTheCloudWhereNoPoseMakesAViewFit) {
  Scene s = turn_with_noise(0.06);
  bend(s.images[2], 2.5);
  std::vector<RigidMotion> poses = s.truth;
  const auto reconciled = reconcile_doubled_sheets(s.images, poses, {});
  ASSERT_TRUE(reconciled) << reconciled.error().what;
  ASSERT_FALSE(reconciled->empty());
  const auto merged = merge_views(s.images, poses, {.sheets = &*reconciled}, {});
  ASSERT_TRUE(merged) << merged.error().what;
  ASSERT_EQ(merged->cloud.sheets_apart.size(), merged->cloud.size());
  const auto marked = std::count_if(merged->cloud.sheets_apart.begin(), merged->cloud.sheets_apart.end(),
                                    [](float apart) { return apart > 0; });
  EXPECT_GT(static_cast<double>(marked), 0.02 * static_cast<double>(merged->cloud.size()));
  EXPECT_LT(static_cast<double>(marked), 0.6 * static_cast<double>(merged->cloud.size()));
}

TEST(DoubledSheets, AreTheSameOnAnyNumberOfThreads) {
  const Scene s = turn_with_noise(0.2);
  const auto poses = moved(s, 1, 1);
  const auto many = find_doubled_sheets(s.images, poses, {});
  const tbb::global_control alone{tbb::global_control::max_allowed_parallelism, 1};
  const auto one = find_doubled_sheets(s.images, poses, {});
  ASSERT_TRUE(one && many);
  ASSERT_FALSE(one->empty());
  EXPECT_EQ(one->apart, many->apart);
}

}  // namespace
}  // namespace telefab::scan
