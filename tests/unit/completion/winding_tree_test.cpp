// SPDX-License-Identifier: GPL-3.0-or-later
#include <telefab/scan/completion/winding_tree.hpp>

#include <gtest/gtest.h>
#include <tbb/global_control.h>
#include <tbb/task_arena.h>

#include <cstring>
#include <random>

#include "sampled_ball.hpp"
#include "tree_sums.hpp"

namespace telefab::scan {
namespace {

using Eigen::Vector3f;

WindingTree tree_of(const Sampled& s) { return WindingTree{s.points, s.normals, s.areas}; }

std::vector<Vector3f> places_about(const Vector3f& centre, float reach, int count) {
  std::mt19937 random{7};
  std::uniform_real_distribution<float> even{-reach, reach};
  std::vector<Vector3f> places;
  for (int i = 0; i < count; ++i) {
    const float x = even(random), y = even(random), z = even(random);
    places.emplace_back(centre.x() + x, centre.y() + y, centre.z() + z);
  }
  return places;
}

/// The sums without a tree, in double.
double winding_of(const Sampled& s, const Vector3f& at) {
  double sum = 0;
  for (std::size_t i = 0; i < s.points.size(); ++i) {
    const Eigen::Vector3d d = (s.points[i] - at).cast<double>();
    const double soft = d.squaredNorm() + s.areas[i] / 4.0;
    sum += s.areas[i] * s.normals[i].cast<double>().dot(d) / (soft * std::sqrt(soft));
  }
  return sum / (4 * std::numbers::pi);
}

double wide_value_of(const Sampled& s, const Vector3f& at) {
  double weight = 0, plane = 0;
  Eigen::Vector3d normal = Eigen::Vector3d::Zero(), offset = Eigen::Vector3d::Zero();
  for (std::size_t i = 0; i < s.points.size(); ++i) {
    const Eigen::Vector3d d = (s.points[i] - at).cast<double>();
    const double theta = s.areas[i] / std::pow(d.squaredNorm() + s.areas[i], 3);
    weight += theta;
    plane -= theta * d.dot(s.normals[i].cast<double>());
    normal += theta * s.normals[i].cast<double>();
    offset += theta * d;
  }
  return (plane / weight - offset.dot(normal.normalized()) / weight) / 2;
}

TEST(WindingTree, TellsInsideFromOutsideOfABall) {
  const Sampled ball = sampled_ball({3, -2, 40}, 10, 4000);
  const WindingTree tree = tree_of(ball);
  for (const Vector3f& p : places_about({3, -2, 40}, 14, 500)) {
    const float from_surface = (p - Vector3f{3, -2, 40}).norm() - 10;
    if (std::abs(from_surface) < 1) continue;
    EXPECT_NEAR(tree.winding(p), from_surface < 0 ? 1 : 0, 0.09) << from_surface;
    EXPECT_NEAR(tree.winding(p, 4), from_surface < 0 ? 1 : 0, 0.03) << from_surface;
  }
}

TEST(WindingTree, IsOneInEitherOfTwoLimbsAndNothingBetweenThem) {
  Sampled limbs = sampled_ball({-6, 0, 0}, 5, 3000);
  limbs.add(sampled_ball({6, 0, 0}, 5, 3000));
  const WindingTree tree = tree_of(limbs);
  EXPECT_NEAR(tree.winding({-6, 1, 1}, 4), 1, 0.025);
  EXPECT_NEAR(tree.winding({6, -1, 2}, 4), 1, 0.025);
  EXPECT_NEAR(tree.winding({0, 0, 0}, 4), 0, 0.025);
}

// With a cap missing the winding number is the solid angle of what is left: on the axis, of a cone.
TEST(WindingTree, IsTheSolidAngleOfAnOpenBall) {
  constexpr float kRim = 0.8F;  // cosine
  const Sampled open = sampled_ball({0, 0, 0}, 10, 40000, [](const Vector3f& n) { return n.z() < kRim; });
  const WindingTree tree = tree_of(open);
  for (const float z : {-8.F, -4.F, 0.F, 3.F, 6.F}) {
    const double rise = 10 * kRim - z, width = 10 * std::sqrt(1 - kRim * kRim);
    const double seen_of_cap = (1 - rise / std::hypot(rise, width)) / 2;
    EXPECT_NEAR(tree.winding({0, 0, z}, 8), 1 - seen_of_cap, 0.006) << z;
  }
}

TEST(WindingTree, AgreesWithThePlainSums) {
  Sampled s = sampled_ball({0, 0, 0}, 10, 3000, [](const Vector3f& n) { return n.x() < 0.7F; });
  s.add(sampled_ball({12, 4, 0}, 3, 700));
  const WindingTree tree = tree_of(s);
  double largest = 0, largest_at_four = 0, sum = 0;
  for (const Vector3f& p : places_about({2, 0, 0}, 14, 400)) {
    largest = std::max(largest, std::abs(tree.winding(p) - winding_of(s, p)));
    sum += std::abs(tree.winding(p) - winding_of(s, p));
    largest_at_four = std::max(largest_at_four, std::abs(tree.winding(p, 4) - winding_of(s, p)));
    EXPECT_NEAR(tree.winding(p, 1e4F), winding_of(s, p), 1e-4);
    const double d = wide_value_of(s, p);
    if (std::abs(d) > 4) continue;
    EXPECT_NEAR(tree.wide(p, 3).value, d, 0.15 + 0.05 * std::abs(d)) << p.transpose();
    EXPECT_NEAR(tree.wide(p, 1e4F).value, d, 1e-3) << p.transpose();
  }
  EXPECT_LT(sum / 400, 0.012);
  EXPECT_LT(largest, 0.09);
  EXPECT_LT(largest_at_four, 0.025);
}

TEST(WindingTree, AnswersTheSameInBlocksAndAlone) {
  const Sampled s = sampled_ball({0, 0, 0}, 10, 5000, [](const Vector3f& n) { return n.x() < 0.7F; });
  const WindingTree tree = tree_of(s);
  std::vector<Vector3f> places;
  for (int i = 0; i < 333; ++i) places.emplace_back(9, 0.02F * static_cast<float>(i), 0.5F);
  const auto windings = tree.windings(places, 3);
  const auto wides = tree.wides(places, 3);
  for (std::size_t i = 0; i < places.size(); ++i) {
    EXPECT_NEAR(windings[i], tree.winding(places[i], 3), 0.03);
    EXPECT_EQ(windings[i], wides[i].winding);
    EXPECT_NEAR(wides[i].value, tree.wide(places[i], 3).value, 0.15);
    EXPECT_NEAR(wides[i].agreement, tree.wide(places[i], 3).agreement, 0.05);
  }
}

TEST(WindingTree, WideIsTheDistanceToABall) {
  const Sampled ball = sampled_ball({0, 0, 0}, 10, 8000);
  const WindingTree tree = tree_of(ball);
  for (const float r : {9.F, 9.5F, 10.F, 10.5F, 11.F}) {
    const WideField f = tree.wide(r * Vector3f{0.6F, 0, 0.8F});
    EXPECT_NEAR(f.value, r - 10, 0.1 * std::abs(r - 10) + 0.02) << r;
    EXPECT_GT(f.agreement, 0.95);
  }
}

// Second order: the sagging of the chord is paid back by the mean of both planes.
TEST(WindingTree, WideBridgesAHoleAsTheBallWould) {
  constexpr float kRim = 0.96F;  // a hole of radius 2.8 in a ball of 10, whose disc lies 0.4 below the ball
  const Sampled open = sampled_ball({0, 0, 0}, 10, 12000, [](const Vector3f& n) { return n.z() < kRim; });
  const WindingTree tree = tree_of(open);
  float low = 8, high = 12;
  while (high - low > 1e-3F) {
    const float middle = (low + high) / 2;
    (tree.wide({0, 0, middle}, 3).value < 0 ? low : high) = middle;
  }
  EXPECT_NEAR(low, 10, 0.1);
}

TEST(WindingTree, DoesNotDependOnTheUnit) {
  const auto scaled = [](float unit) {
    Sampled s = sampled_ball(Vector3f{1, 2, 3} * unit, 10 * unit, 2000);
    return tree_of(s).wide(Vector3f{1, 2, 12} * unit);
  };
  for (const float unit : {1e-4F, 1e5F}) {
    EXPECT_NEAR(scaled(unit).winding, scaled(1).winding, 1e-3);
    EXPECT_NEAR(scaled(unit).value / unit, scaled(1).value, 1e-2);
  }
}

TEST(WindingTree, MeanNormalTellsWhatIsMissing) {
  EXPECT_LT(tree_of(sampled_ball({0, 0, 0}, 1, 2000)).mean_normal().norm(), 1e-3);
  const auto half = tree_of(sampled_ball({0, 0, 0}, 1, 20000, [](const Vector3f& n) { return n.z() > 0; }));
  EXPECT_NEAR(half.mean_normal().z(), 0.5, 1e-3);  // of a half ball: pi r^2 over 2 pi r^2
}

TEST(WindingTree, OfNothingIsOutsideEverywhere) {
  const WindingTree tree{{}, {}, {}};
  EXPECT_EQ(tree.size(), 0u);
  EXPECT_EQ(tree.winding({1, 2, 3}), 0);
  EXPECT_EQ(tree.wide({1, 2, 3}).agreement, 0);
}

TEST(WindingTree, SamplesWithoutAreaOrInOnePlaceDoNotBreakIt) {
  Sampled s = sampled_ball({0, 0, 0}, 10, 2000);
  for (int i = 0; i < 500; ++i) {
    s.points.emplace_back(10, 0, 0);
    s.normals.emplace_back(1, 0, 0);
    s.areas.push_back(0);
  }
  const WindingTree tree = tree_of(s);
  EXPECT_NEAR(tree.winding({0, 0, 0}, 8), 1, 0.02);
  EXPECT_TRUE(std::isfinite(tree.wide({10, 0, 0}).value));
}

TEST(WindingTree, GivesTheSameBytesOnAnyNumberOfThreads) {
  const Sampled s = sampled_ball({0, 0, 0}, 10, 30000, [](const Vector3f& n) { return n.x() < 0.9F; });
  const auto places = places_about({0, 0, 0}, 12, 3000);
  const auto answers = [&](int threads) {
    const tbb::global_control allow{tbb::global_control::max_allowed_parallelism, 8};
    tbb::task_arena arena{threads};
    return arena.execute([&] { return tree_of(s).wides(places); });
  };
  const auto one = answers(1), eight = answers(8);
  EXPECT_EQ(std::memcmp(one.data(), eight.data(), one.size() * sizeof(WideField)), 0);
}

#ifdef TELEFAB_TREE_AVX2
TEST(WindingTree, SumsAreTheSameWithAndWithoutWideRegisters) {
  if (!__builtin_cpu_supports("avx2")) GTEST_SKIP() << "no AVX2 here";
  std::mt19937 random{3};
  std::normal_distribution<float> bell;
  std::vector<TreeSample> samples(100);
  for (TreeSample& s : samples) s = {bell(random), bell(random), bell(random), 1, bell(random), bell(random), 1};
  std::vector<TreeMoments> moments(20);
  std::vector<const TreeMoments*> nodes;
  for (TreeMoments& m : moments) {
    m = {9 + bell(random), bell(random), 5, 3, bell(random), 1, 1, bell(random), 1, 2, bell(random), 1, 3, 1, 0.5F};
    nodes.push_back(&m);
  }
  const TreeList list{samples.data(), samples.size(), nodes.data(), nodes.size()};
  TreePlaces at{{0.1F, 0.2F, 0.3F}, {}, {}, {}};
  for (std::size_t l = 0; l < kTreeLanes; ++l) at.x[l] = bell(random), at.y[l] = bell(random), at.z[l] = bell(random);
  TreeSums narrow{}, broad{};
  baseline_tree_sums().wide(list, at, narrow);
  avx2_tree_sums().wide(list, at, broad);
  EXPECT_EQ(std::memcmp(&narrow, &broad, sizeof narrow), 0);
}
#endif

}  // namespace
}  // namespace telefab::scan
