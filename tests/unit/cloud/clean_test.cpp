// SPDX-License-Identifier: GPL-3.0-or-later
#include <telefab/scan/cloud/clean.hpp>

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <telefab/scan/cloud/units.hpp>
#include <telefab/scan/formats/write_cloud.hpp>
#include <telefab/test/surface_samples.hpp>

namespace telefab::scan {
namespace {

PointCloud ball(double noise_mm) {
  PointCloud cloud;
  for (const Vec3& p : test::sample_surface(*test::sphere(10, 1), {.spacing_mm = 0.5, .noise_mm = noise_mm}).points)
    cloud.points.push_back(p.cast<float>());
  return cloud;
}

TEST(Clean, RemovesOutliersClustersAndDuplicatesAndNothingElse) {
  PointCloud cloud = ball(0.02);
  const std::size_t good = cloud.size();
  for (int i = 0; i < 20; ++i)
    cloud.points.emplace_back(14.F + 3.F * static_cast<float>(i), static_cast<float>((i * 7) % 5) * 4.F,
                              -9.F);  // far apart
  cloud.points.push_back(cloud.points[0]);
  const auto cleaned = clean_cloud(cloud, CleanOptions::careful(), {});
  ASSERT_TRUE(cleaned) << cleaned.error().what;
  EXPECT_EQ(cleaned->report.duplicates, 1U);
  EXPECT_EQ(cleaned->report.outliers + cleaned->report.cluster_points, 20U);
  EXPECT_EQ(cleaned->cloud.size(), good);
  for (std::size_t i = 0; i < good; ++i) EXPECT_EQ(cleaned->fate[i], PointFate::Kept);
  EXPECT_EQ(cleaned->report.moved_max, 0);
}

TEST(Clean, EstimatesTheNoiseItIsGiven) {
  for (const double sigma : {0.02, 0.08}) {
    const auto cleaned = clean_cloud(ball(sigma), CleanOptions::careful(), {});
    ASSERT_TRUE(cleaned);
    EXPECT_NEAR(cleaned->report.noise, sigma, 0.25 * sigma);
  }
}

TEST(Clean, StrongSmoothsTowardsTheSurface) {
  const auto cleaned = clean_cloud(ball(0.1), CleanOptions::strong(), {});
  ASSERT_TRUE(cleaned);
  double square = 0;
  for (const auto& p : cleaned->cloud.points)
    square += std::pow(static_cast<double>(p.norm()) - 10, 2) / static_cast<double>(cleaned->cloud.size());
  EXPECT_LT(std::sqrt(square), 0.07);
  EXPECT_LT(cleaned->report.noise_after, cleaned->report.noise);
  EXPECT_GT(cleaned->report.moved_rms, 0.03);
}

TEST(Clean, RefusesOptionsAndCloudsItCannotUse) {
  EXPECT_FALSE(CleanOptions{.neighbours = 2}.validate());
  EXPECT_FALSE(CleanOptions{.outlier_factor = 1}.validate());
  EXPECT_FALSE(CleanOptions{.least_cluster = 1}.validate());
  EXPECT_EQ(clean_cloud({}, {}, {}).error().code, ErrorCode::InvalidInput);
}

TEST(WriteCloud, IsReadBackAsItWas) {
  PointCloud cloud = ball(0);
  cloud.normals.assign(cloud.size(), Eigen::Vector3f::UnitZ());
  cloud.normals[7] = Eigen::Vector3f::UnitX();  // all the same they would be dropped
  cloud.confidence.assign(cloud.size(), 0.5F);
  cloud.confidence[0] = 1;
  const std::vector<PointColour> colours(cloud.size(), PointColour{1, 2, 3});
  const auto back = read_cloud(write_ply(cloud, colours, "two\nlines"), "a.ply", {}, {});
  ASSERT_TRUE(back) << back.error().what;
  EXPECT_EQ(back->points, cloud.points);
  EXPECT_EQ(back->normals, cloud.normals);
  EXPECT_EQ(back->confidence, cloud.confidence);
}

TEST(Units, AreKnownOrRefused) {
  EXPECT_EQ(millimetres_per("m").value(), 1000);
  EXPECT_EQ(millimetres_per("in").value(), 25.4);
  EXPECT_FALSE(millimetres_per("furlong"));
}

TEST(Units, WarnOfASizeThatIsHardlyMeantAndNameTheUnitThatFits) {
  using testing::HasSubstr;
  EXPECT_FALSE(scale_warning(ball(0), 1));
  EXPECT_THAT(scale_warning(Vec3{0.08, 0.05, 0.03}, 1).value(), HasSubstr("it is 80 mm: say --units m"));
  EXPECT_THAT(scale_warning(Vec3{1, 1.5, 1}, 1).value(), HasSubstr("say --units m"));
  EXPECT_THAT(scale_warning(Vec3{80000, 5, 3}, 1000).value(), HasSubstr("it is 80 mm: say --units mm"));
  EXPECT_THAT(scale_warning(Vec3{80000, 5, 3}, 1).value(), HasSubstr("--height-mm"));
  EXPECT_FALSE(scale_warning(PointCloud{}, 1));
}

TEST(Units, StayRightWhenACloudIsScaled) {
  PointCloud cloud = ball(0);
  EXPECT_FALSE(scaled(cloud, 10).unit_mm);
  cloud.unit_mm = 1000;
  EXPECT_EQ(scaled(cloud, 1000).unit_mm, 1);
}

}  // namespace
}  // namespace telefab::scan
