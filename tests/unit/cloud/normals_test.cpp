// SPDX-License-Identifier: GPL-3.0-or-later
#include <telefab/scan/cloud/normals.hpp>

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <oneapi/tbb/global_control.h>
#include <random>
#include <telefab/scan/cloud/kd_tree.hpp>
#include <telefab/test/surface_samples.hpp>

namespace telefab::scan {
namespace {

struct Truth {
  PointCloud cloud;  ///< without normals
  std::vector<Eigen::Vector3f> normals;
};

void append(Truth& to, const test::SurfaceSamples& samples, const Vec3& shift = Vec3::Zero(), float sign = 1) {
  for (std::size_t i = 0; i < samples.points.size(); ++i) {
    to.cloud.points.push_back((samples.points[i] + shift).cast<float>());
    to.normals.push_back(sign * samples.normals[i].cast<float>());
  }
}

Truth samples_of(const test::Shape& shape, double spacing_mm, double noise_mm = 0) {
  Truth truth;
  append(truth, test::sample_surface(*shape, {.spacing_mm = spacing_mm, .noise_mm = noise_mm}));
  return truth;
}

double share_right(const std::vector<Eigen::Vector3f>& normals, const std::vector<Eigen::Vector3f>& truth) {
  std::size_t right = 0;
  for (std::size_t i = 0; i < truth.size(); ++i) right += normals.at(i).dot(truth[i]) > 0 ? 1 : 0;
  return static_cast<double>(right) / static_cast<double>(truth.size());
}

double share_right(const Truth& truth) {
  const auto made = with_normals(truth.cloud, {}, {});
  EXPECT_TRUE(made) << made.error().what;
  EXPECT_GT(truth.cloud.size(), 500U) << "not a test with so few points";
  return made ? share_right(made->cloud.normals, truth.normals) : 0;
}

TEST(Normals, PointOutwardOnShapesOfEveryKind) {
  EXPECT_EQ(share_right(samples_of(test::sphere(10, 1), 0.8)), 1);
  EXPECT_EQ(share_right(samples_of(test::torus(10, 3, 40, 1), 0.7)), 1);
  EXPECT_EQ(share_right(samples_of(test::genus_two(10, 1), 0.5)), 1);
  EXPECT_GT(share_right(samples_of(test::flat_box({10, 6, 3}, 0.2, 1), 0.5)), 0.999);
  EXPECT_GT(share_right(samples_of(test::bored_plate(3, 4, 0.3, 1), 0.6)), 0.999);
  EXPECT_GT(share_right(samples_of(test::bumpy(10, 1), 0.4)), 0.999);
}

TEST(Normals, TellTheTwoSidesOfAThinWallApart) {
  EXPECT_GT(share_right(samples_of(test::thin_wall(20, 20, 0.8, 1), 0.5)), 0.99);
}

TEST(Normals, PointIntoABowl) { EXPECT_GT(share_right(samples_of(test::bowl(12, 1.5, 1), 0.5)), 0.999); }

TEST(Normals, PointIntoAClosedVoid) { EXPECT_EQ(share_right(samples_of(test::hollow_sphere(10, 3, 1), 0.6)), 1); }

TEST(Normals, StayOutwardUnderNoise) { EXPECT_GT(share_right(samples_of(test::torus(10, 3, 40, 1), 0.5, 0.1)), 0.995); }

TEST(Normals, OfNearBodiesAreNotMixedUp) {
  EXPECT_EQ(share_right(samples_of(test::near_touching_balls(8, 1.2, 1), 0.5)), 1);
}

TEST(Normals, OfAnOpenShellPointAwayFromItsMiddle) {
  Truth shell;
  const Truth ball = samples_of(test::sphere(10, 1), 0.7);
  for (std::size_t i = 0; i < ball.cloud.size(); ++i)
    if (ball.cloud.points[i].z() > -2) {
      shell.cloud.points.push_back(ball.cloud.points[i]);
      shell.normals.push_back(ball.normals[i]);
    }
  EXPECT_EQ(share_right(shell), 1);
}

TEST(Normals, EstimatedComeNearTheTrueOnes) {
  const Truth truth = samples_of(test::sphere(10, 1), 0.6);
  const auto made = with_normals(truth.cloud, {}, {});
  ASSERT_TRUE(made);
  float worst = 1;
  for (std::size_t i = 0; i < truth.normals.size(); ++i)
    worst = std::min(worst, made->cloud.normals[i].dot(truth.normals[i]));
  EXPECT_GT(worst, 0.99F);
  EXPECT_TRUE(made->report.estimated);
  EXPECT_EQ(made->report.pieces, 1U);
  EXPECT_GT(made->report.outside_known, 0.9);
  EXPECT_EQ(made->report.uncertain_points, 0U);
}

TEST(Normals, AreEstimatedWhateverTheCloudHas) {
  Truth truth = samples_of(test::torus(10, 3, 40, 1), 0.7);
  truth.cloud.normals.assign(truth.normals.size(), Eigen::Vector3f::UnitX());
  const auto made = with_normals(truth.cloud, {}, {});
  ASSERT_TRUE(made);
  EXPECT_TRUE(made->report.estimated);
  for (std::size_t i = 0; i < truth.normals.size(); ++i) ASSERT_GT(made->cloud.normals[i].dot(truth.normals[i]), 0.9F);
}

TEST(Normals, AreTheSameOnOneThreadAndOnMany) {
  const Truth truth = samples_of(test::bumpy(10, 1), 0.5, 0.05);
  std::vector<std::vector<Eigen::Vector3f>> made;
  for (const std::size_t threads : {1, 3}) {
    const oneapi::tbb::global_control limit{oneapi::tbb::global_control::max_allowed_parallelism, threads};
    made.push_back(with_normals(truth.cloud, {}, {}).value().cloud.normals);
  }
  EXPECT_EQ(made[0], made[1]);
}

TEST(Normals, RefuseCloudsThatHaveNoSurface) {
  PointCloud three;
  three.points.assign(3, Eigen::Vector3f::UnitX());
  EXPECT_EQ(with_normals(three, {}, {}).error().code, ErrorCode::InvalidInput);
  PointCloud heap;
  heap.points.assign(100, Eigen::Vector3f::UnitX());
  EXPECT_EQ(with_normals(heap, {}, {}).error().code, ErrorCode::InvalidInput);
  PointCloud line;
  for (int i = 0; i < 100; ++i) line.points.emplace_back(static_cast<float>(i), 0.F, 0.F);
  const auto made = with_normals(line, {}, {});
  ASSERT_TRUE(made) << "a line has normals, if arbitrary ones";
  for (const auto& n : made->cloud.normals) EXPECT_NEAR(n.norm(), 1, 1e-4);
}

TEST(Normals, RefuseOptionsOutOfRange) {
  EXPECT_FALSE(NormalOptions{.neighbours = 5}.validate());
  EXPECT_FALSE(NormalOptions{.neighbours = 65}.validate());
  EXPECT_TRUE(NormalOptions{}.validate());
}

TEST(Normals, StopWhenAsked) {
  std::stop_source stop;
  stop.request_stop();
  const auto made = with_normals(samples_of(test::sphere(10, 1), 1).cloud, {}, stop.get_token());
  ASSERT_FALSE(made);
  EXPECT_EQ(made.error().code, ErrorCode::Cancelled);
}

TEST(KdTree, FindsWhatASearchOverAllPointsFinds) {
  std::mt19937 rng{7};
  std::uniform_real_distribution<float> unit{-1, 1};
  std::vector<Eigen::Vector3f> points(500);
  for (auto& p : points) p = {unit(rng), unit(rng), unit(rng)};
  const KdTree tree{points};
  for (int q = 0; q < 50; ++q) {
    const Eigen::Vector3f query{unit(rng), unit(rng), unit(rng)};
    std::vector<float> all;
    for (const auto& p : points) all.push_back((p - query).squaredNorm());
    std::sort(all.begin(), all.end());
    std::vector<Neighbour> found(9);
    ASSERT_EQ(tree.nearest(query, found), 9U);
    for (std::size_t i = 0; i < found.size(); ++i) EXPECT_FLOAT_EQ(found[i].squared_distance, all[i]);
    EXPECT_FLOAT_EQ(tree.nearest(query).squared_distance, all[0]);
    const auto near = tree.nearest_within(query, 0.2F);
    ASSERT_EQ(near.has_value(), all[0] <= 0.2F * 0.2F);
    if (near) {
      EXPECT_EQ(near->index, tree.nearest(query).index);
    }
    const auto within = tree.within(query, 0.4F);
    EXPECT_EQ(within.size(),
              static_cast<std::size_t>(std::count_if(all.begin(), all.end(), [](float d) { return d < 0.16F; })));
  }
}

}  // namespace
}  // namespace telefab::scan
