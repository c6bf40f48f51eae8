// SPDX-License-Identifier: GPL-3.0-or-later
#include <telefab/scan/cloud/two_sheets.hpp>

#include <gtest/gtest.h>
#include <oneapi/tbb/global_control.h>
#include <cmath>
#include <telefab/test/surface_samples.hpp>

namespace telefab::scan {
namespace {

constexpr double kSpacing = 0.8;

PointCloud cloud_of(const test::Shape& shape, double noise_mm, std::uint64_t seed = 1) {
  PointCloud cloud;
  const auto samples = test::sample_surface(*shape, {.spacing_mm = kSpacing, .noise_mm = noise_mm, .seed = seed});
  for (std::size_t i = 0; i < samples.points.size(); ++i) {
    cloud.points.push_back(samples.points[i].cast<float>());
    cloud.normals.push_back(samples.normals[i].cast<float>());
  }
  return cloud;
}

/// What a second view shows of the half with y > 0, moved out along its normals.
PointCloud with_second_view(const test::Shape& shape, double noise_mm, double apart_mm) {
  PointCloud cloud = cloud_of(shape, noise_mm, 1);
  const PointCloud other = cloud_of(shape, noise_mm, 2);
  for (std::size_t i = 0; i < other.size(); ++i) {
    if (other.points[i].y() < 0) continue;
    cloud.points.push_back(other.points[i] + static_cast<float>(apart_mm) * other.normals[i]);
    cloud.normals.push_back(other.normals[i]);
  }
  return cloud;
}

std::size_t marked(PointCloud cloud) {
  const auto count = mark_two_sheets(cloud, {});
  EXPECT_TRUE(count);
  EXPECT_EQ(cloud.sheets_apart.empty(), *count == 0);
  return count.value_or(0);
}

TEST(TwoSheets, FindsNoneWhereThereIsOneSurfaceOfAnyShapeAndNoise) {
  for (const double noise : {0.0, 0.1, 0.3, 0.6}) {
    EXPECT_EQ(marked(cloud_of(test::sphere(15, 1), noise * kSpacing)), 0U) << noise;
    EXPECT_EQ(marked(cloud_of(test::torus(12, 4, 90, 1), noise * kSpacing)), 0U) << noise;
    EXPECT_EQ(marked(cloud_of(test::genus_two(14, 1), noise * kSpacing)), 0U) << noise;
    EXPECT_EQ(marked(cloud_of(test::flat_box({16, 12, 6}, 0.2, 1), noise * kSpacing)), 0U) << noise;
    EXPECT_EQ(marked(with_second_view(test::sphere(15, 1), noise * kSpacing, 0)), 0U) << noise << ", seen twice";
  }
}

TEST(TwoSheets, FindsNoneInAThinWallWhoseSidesAreAsNearAsSheets) {
  EXPECT_EQ(marked(cloud_of(test::flat_box({16, 12, 0.8}, 0.1, 1), 0.05)), 0U);
  EXPECT_EQ(marked(cloud_of(test::bored_plate(3, 4, 0.3, 1), 0.05)), 0U);
}

TEST(TwoSheets, FindsTheHalfThatTwoViewsShowApartAndHowFar) {
  for (const double apart : {1.0, 2.0, 3.0})
    for (const double noise : {0.05, 0.2}) {
      PointCloud cloud = with_second_view(test::sphere(15, 1), noise * kSpacing, apart * kSpacing);
      ASSERT_TRUE(mark_two_sheets(cloud, {}));
      ASSERT_EQ(cloud.sheets_apart.size(), cloud.size()) << apart << " spacings, noise " << noise;
      std::size_t there = 0, found = 0, elsewhere = 0;
      for (std::size_t i = 0; i < cloud.size(); ++i) {
        const bool is_doubled = cloud.points[i].y() > 0;
        there += is_doubled ? 1 : 0;
        if (!(cloud.sheets_apart[i] > 0)) continue;
        found += is_doubled ? 1 : 0;
        elsewhere += cloud.points[i].y() < -6 ? 1 : 0;  // a place is up to 5 mm wide
        EXPECT_NEAR(cloud.sheets_apart[i], apart * kSpacing, 0.45 * apart * kSpacing + noise * kSpacing);
      }
      EXPECT_GT(static_cast<double>(found), 0.7 * static_cast<double>(there)) << apart << ", noise " << noise;
      EXPECT_EQ(elsewhere, 0U) << apart << ", noise " << noise;
    }
}

TEST(TwoSheets, AreTheSameOnAnyNumberOfThreads) {
  PointCloud one = with_second_view(test::torus(12, 4, 90, 1), 0.1, 1.2), many = one;
  {
    const tbb::global_control alone{tbb::global_control::max_allowed_parallelism, 1};
    ASSERT_TRUE(mark_two_sheets(one, {}));
  }
  const tbb::global_control eight{tbb::global_control::max_allowed_parallelism, 8};
  ASSERT_TRUE(mark_two_sheets(many, {}));
  ASSERT_FALSE(one.sheets_apart.empty());
  EXPECT_EQ(one.sheets_apart, many.sheets_apart);
}

}  // namespace
}  // namespace telefab::scan
