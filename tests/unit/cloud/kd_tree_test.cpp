// SPDX-License-Identifier: GPL-3.0-or-later
#include <gtest/gtest.h>
#include <tbb/global_control.h>

#include <algorithm>
#include <random>
#include <telefab/scan/cloud/kd_tree.hpp>

namespace telefab::test {
namespace {

using Eigen::Vector3f;
using scan::KdTree;
using scan::Neighbour;

std::vector<Vector3f> random_points(std::size_t count, unsigned seed) {
  std::mt19937 random{seed};
  std::uniform_real_distribution<float> at{-1, 1};
  std::vector<Vector3f> points(count);
  for (Vector3f& p : points) p = {at(random), at(random), 0.2F * at(random)};
  return points;
}

/// Many points at equal distances.
std::vector<Vector3f> lattice(int side) {
  std::vector<Vector3f> points;
  for (int z = 0; z < side; ++z)
    for (int y = 0; y < side; ++y)
      for (int x = 0; x < side; ++x)
        points.emplace_back(static_cast<float>(x), static_cast<float>(y), static_cast<float>(z));
  return points;
}

std::vector<float> distances_by_hand(std::span<const Vector3f> points, const Vector3f& query) {
  std::vector<float> squared;
  for (const Vector3f& p : points) {
    const Vector3f d = p - query;
    squared.push_back(d.x() * d.x() + d.y() * d.y() + d.z() * d.z());
  }
  std::sort(squared.begin(), squared.end());
  return squared;
}

void expect_nearest(std::span<const Vector3f> points, const KdTree& tree, const Vector3f& query, std::size_t wanted) {
  std::vector<Neighbour> found(wanted);
  const std::size_t count = tree.nearest(query, found);
  ASSERT_EQ(count, std::min(wanted, points.size()));
  const std::vector<float> squared = distances_by_hand(points, query);
  std::vector<bool> seen(points.size(), false);
  for (std::size_t k = 0; k < count; ++k) {
    EXPECT_EQ(found[k].squared_distance, squared[k]);
    EXPECT_EQ(found[k].squared_distance, distances_by_hand({&points[found[k].index], 1}, query)[0]);
    EXPECT_FALSE(seen[found[k].index]) << "point " << found[k].index << " came twice";
    seen[found[k].index] = true;
  }
}

TEST(KdTree, FindsTheNearestPointsAsTheyAreFoundByHand) {
  for (const auto& points : {random_points(3000, 1), lattice(9), random_points(7, 2), random_points(1, 3)}) {
    const KdTree tree{points};
    ASSERT_EQ(tree.size(), points.size());
    for (const Vector3f& query : random_points(60, 4))
      for (const std::size_t wanted : {1U, 2U, 11U, 40U}) expect_nearest(points, tree, query, wanted);
    for (std::size_t i = 0; i < points.size(); i += 37) expect_nearest(points, tree, points[i], 8);
  }
}

TEST(KdTree, FindsManyPointsInOnePlace) {
  std::vector<Vector3f> points(500, Vector3f{1, 2, 3});
  points.emplace_back(0, 0, 0);
  const KdTree tree{points};
  expect_nearest(points, tree, {1, 2, 3}, 20);
  expect_nearest(points, tree, {0, 0, 0}, 501);
}

TEST(KdTree, FindsAllWithinARadiusAndTheNearestWithinAReach) {
  const auto points = random_points(2000, 5);
  const KdTree tree{points};
  for (const Vector3f& query : random_points(40, 6)) {
    const std::vector<float> squared = distances_by_hand(points, query);
    const auto found = tree.within(query, 0.3F);
    const auto wanted = std::lower_bound(squared.begin(), squared.end(), 0.3F * 0.3F) - squared.begin();
    ASSERT_EQ(found.size(), static_cast<std::size_t>(wanted));
    for (std::size_t k = 0; k < found.size(); ++k) EXPECT_EQ(found[k].squared_distance, squared[k]);
    const float least = std::sqrt(squared[0]);
    ASSERT_TRUE(tree.nearest_within(query, 1.01F * least));
    EXPECT_EQ(tree.nearest_within(query, 1.01F * least)->squared_distance, squared[0]);
    EXPECT_FALSE(tree.nearest_within(query, 0.99F * least));
  }
}

TEST(KdTree, KnowsEveryPointByItsIndexAndHasEachInALeafOnce) {
  const auto points = random_points(1000, 7);
  const KdTree tree{points};
  for (std::uint32_t i = 0; i < points.size(); ++i) EXPECT_EQ(tree.point(i), points[i]);
  std::vector<std::uint32_t> order{tree.leaf_order().begin(), tree.leaf_order().end()};
  std::sort(order.begin(), order.end());
  for (std::uint32_t i = 0; i < points.size(); ++i) EXPECT_EQ(order[i], i);
}

TEST(KdTree, IsTheSameOnAnyNumberOfThreads) {
  const auto points = random_points(60'000, 8);
  const KdTree many{points};
  const tbb::global_control one{tbb::global_control::max_allowed_parallelism, 1};
  const KdTree alone{points};
  EXPECT_TRUE(std::equal(many.leaf_order().begin(), many.leaf_order().end(), alone.leaf_order().begin()));
  std::vector<Neighbour> a(30), b(30);
  for (const Vector3f& query : random_points(200, 9)) {
    ASSERT_EQ(many.nearest(query, a), alone.nearest(query, b));
    for (std::size_t k = 0; k < a.size(); ++k) EXPECT_EQ(a[k].index, b[k].index);
  }
}

TEST(KdTree, OfNoPointsFindsNothing) {
  const KdTree tree{{}};
  std::vector<Neighbour> found(3);
  EXPECT_EQ(tree.nearest({0, 0, 0}, found), 0U);
  EXPECT_TRUE(tree.within({0, 0, 0}, 1).empty());
  EXPECT_FALSE(tree.nearest_within({0, 0, 0}, 1));
}

}  // namespace
}  // namespace telefab::test
