// SPDX-License-Identifier: GPL-3.0-or-later
#include <telefab/scan/slicing/orient_cloud.hpp>

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>
#include <random>
#include <telefab/test/analytic_field.hpp>
#include <telefab/test/solid.hpp>
#include <telefab/test/surface_samples.hpp>

namespace telefab::scan {
namespace {

PointCloud cloud_of(const test::SurfaceSamples& samples) {
  PointCloud cloud;
  for (std::size_t i = 0; i < samples.points.size(); ++i) {
    cloud.points.push_back(samples.points[i].cast<float>());
    cloud.normals.push_back(samples.normals[i].cast<float>());
  }
  return cloud;
}

void add(PointCloud& to, const PointCloud& more, const Vec3& shift, float way = 1) {
  for (std::size_t i = 0; i < more.size(); ++i) {
    to.points.push_back(more.points[i] + shift.cast<float>());
    to.normals.push_back(way * more.normals[i]);
  }
}

PointCloud ball(double radius, double spacing) {
  return cloud_of(test::sample_surface(*test::sphere(radius, 1), {.spacing_mm = spacing, .seed = 41}));
}

OrientedCloud oriented(const PointCloud& cloud) {
  auto result = orient_cloud(cloud, {});
  EXPECT_TRUE(result) << result.error().what;
  return result ? std::move(*result) : OrientedCloud{};
}

double share_right(const OrientedCloud& made, const PointCloud& truth) {
  std::size_t right = 0;
  for (std::size_t i = 0; i < truth.size(); ++i) right += made.cloud.normals[i].dot(truth.normals[i]) > 0 ? 1 : 0;
  return static_cast<double>(right) / static_cast<double>(truth.size());
}

void expect_kept(const PointCloud& cloud) {
  const OrientedCloud made = oriented(cloud);
  EXPECT_EQ(made.cloud.normals, cloud.normals);
  EXPECT_EQ(made.report.flipped_points, 0U);
  EXPECT_EQ(made.report.disagreeing_points, 0U);
  EXPECT_TRUE(made.warnings.empty());
}

TEST(GivenNormals, AreKeptWhereTheyPointOutward) {
  expect_kept(cloud_of(test::sample_surface(*test::torus(10, 3, 40, 1), {.spacing_mm = 0.7, .seed = 2})));
  expect_kept(ball(10, 0.6));
}

TEST(GivenNormals, OfBallsThatTouchAreKept) {
  for (const double radius : {10., 4.})
    for (const Vec3& way : {Vec3{1, 0, 0}, Vec3{0, 0, 1}, Vec3{0.6, 0.48, 0.64}}) {
      PointCloud two = ball(10, 0.4);
      add(two, ball(radius, 0.4), (10 + radius) * way);
      expect_kept(two);
    }
  PointCloud row;
  for (int i = 0; i < 4; ++i) add(row, ball(5, 0.4), {10. * i, 0, 0});
  expect_kept(row);
}

TEST(GivenNormals, OfWallsOneSpacingThickAreKept) {
  for (const double half : {0.25, 0.5}) {
    const auto samples = test::sample_solid(test::solid_box({8, half, 8}, 0.4 * half), 0.5, 9);
    const PointCloud wall = cloud_of(samples);
    const OrientedCloud made = oriented(wall);
    EXPECT_EQ(made.cloud.normals, wall.normals) << half;
    EXPECT_EQ(made.report.replaced_points, 0U) << half;
  }
}

TEST(GivenNormals, OfShellsWithinShellsAreKept) {
  expect_kept(cloud_of(test::sample_surface(*test::hollow_sphere(10, 3, 1), {.spacing_mm = 0.6, .seed = 3})));
  PointCloud nested = ball(10, 0.5);  // solid, void, solid
  add(nested, ball(7, 0.5), {0, 0, 0}, -1);
  add(nested, ball(4, 0.5), {0, 0, 0});
  expect_kept(nested);
}

TEST(GivenNormals, AreTurnedByThePieceWhereTheyPointInward) {
  const PointCloud right = ball(10, 0.6);
  PointCloud turned;
  add(turned, right, {0, 0, 0}, -1);
  const OrientedCloud all = oriented(turned);
  EXPECT_EQ(all.cloud.normals, right.normals);
  EXPECT_EQ(all.report.flipped_points, right.size());
  EXPECT_NE(all.warnings.at(0).find("pointed inward"), std::string::npos);

  PointCloud truth = right, one_turned = right;
  add(truth, ball(5, 0.6), {30, 0, 0});
  add(one_turned, ball(5, 0.6), {30, 0, 0}, -1);
  const OrientedCloud one = oriented(one_turned);
  EXPECT_EQ(one.cloud.normals, truth.normals);
  EXPECT_EQ(one.report.flipped_points, truth.size() - right.size());
}

TEST(GivenNormals, ThatDisagreeWithTheShapeAreSaidAndReplaced) {
  const PointCloud truth = ball(10, 0.6);
  PointCloud noise = truth, mixed = truth;
  std::mt19937_64 dice{4};
  for (Eigen::Vector3f& n : noise.normals) {
    for (int axis = 0; axis < 3; ++axis) n[axis] = static_cast<float>(dice() % 2001) / 1000 - 1;
    n.normalize();
  }
  for (std::size_t i = 0; i < mixed.size(); i += 4) mixed.normals[i] = -mixed.normals[i];
  PointCloud constant = truth;
  constant.normals.assign(truth.size(), Eigen::Vector3f::UnitX());
  for (const PointCloud& given : {noise, mixed, constant}) {
    const OrientedCloud made = oriented(given);
    EXPECT_EQ(share_right(made, truth), 1);
    EXPECT_EQ(made.report.disagreeing_points, truth.size());
    EXPECT_EQ(made.report.replaced_points, truth.size());
    EXPECT_NE(made.warnings.at(0).find("given normals disagree with the shape"), std::string::npos);
  }
}

TEST(GivenNormals, OfOpenScansAreKept) {
  PointCloud half;
  const PointCloud whole = ball(10, 0.5);
  for (std::size_t i = 0; i < whole.size(); ++i)
    if (whole.points[i].z() > 0) {
      half.points.push_back(whole.points[i]);
      half.normals.push_back(whole.normals[i]);
    }
  expect_kept(half);
}

TEST(OrientCloud, EstimatesWhereNoneAreGiven) {
  PointCloud truth = ball(10, 0.6);
  PointCloud bare = truth;
  bare.normals.clear();
  const OrientedCloud made = oriented(bare);
  EXPECT_TRUE(made.report.estimated);
  EXPECT_EQ(share_right(made, truth), 1);
}

/// Two flat caps that meet in a sharp rim; the first `rim` samples lie on it, as the corners of a mesh do.
PointCloud lens(double height, std::size_t rim, int of_cap) {
  constexpr double kRadius = 10;
  PointCloud cloud;
  const auto put = [&](const Vec3& place, const Vec3& outward) {
    cloud.points.push_back(place.cast<float>());
    cloud.normals.push_back(outward.normalized().cast<float>());
  };
  for (std::size_t k = 0; k < rim; ++k) {
    const double angle = 2 * std::numbers::pi * static_cast<double>(k) / static_cast<double>(rim);
    put({kRadius * std::cos(angle), kRadius * std::sin(angle), 0}, {std::cos(angle), std::sin(angle), 0});
  }
  for (const double side : {1.0, -1.0})
    for (int k = 0; k < of_cap; ++k) {
      const double r = 0.97 * kRadius * std::sqrt((k + 0.5) / of_cap), angle = k * 2.399963 + side;
      const double slope = 2 * height * r / (kRadius * kRadius);
      put({r * std::cos(angle), r * std::sin(angle), side * height * (1 - r * r / (kRadius * kRadius))},
          {slope * std::cos(angle), slope * std::sin(angle), side});
    }
  return cloud;
}

TEST(OrientCloud, TurnsTheNormalsOnASharpEdgeAwayFromTheInside) {
  constexpr std::size_t kRim = 112;
  const PointCloud truth = lens(3, kRim, 1000);
  PointCloud bare = truth;
  bare.normals.clear();
  const OrientedCloud made = oriented(bare);
  std::size_t right = 0;
  for (std::size_t i = 0; i < kRim; ++i) right += made.cloud.normals[i].dot(truth.normals[i]) > 0.9F ? 1 : 0;
  EXPECT_EQ(right, kRim);
  EXPECT_EQ(share_right(made, truth), 1);
}

TEST(OrientCloud, SparesNoneOfAFewThousandPointsOfAThinBody) {
  const PointCloud truth = lens(0.8, 190, 2700);
  PointCloud bare = truth;
  bare.normals.clear();
  const OrientedCloud made = oriented(bare);
  EXPECT_TRUE(made.report.by_winding);
  EXPECT_EQ(share_right(made, truth), 1);  // 0.945 with every second point
}

}  // namespace
}  // namespace telefab::scan
