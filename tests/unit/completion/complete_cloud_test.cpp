// SPDX-License-Identifier: GPL-3.0-or-later
#include <telefab/scan/completion/complete_cloud.hpp>
#include <telefab/scan/completion/facing.hpp>

#include <gtest/gtest.h>
#include <tbb/global_control.h>
#include <tbb/task_arena.h>

#include <algorithm>
#include <random>

#include "sampled_ball.hpp"

namespace telefab::scan {
namespace {

using Eigen::Vector3f;

/// Even samples of a torus about z, those only that `seen` keeps.
Sampled sampled_torus(float ring, float tube, float spacing, const std::function<bool(const Vector3f&)>& seen) {
  Sampled s;
  const int rows = static_cast<int>(2 * std::numbers::pi * tube / spacing);
  for (int row = 0; row < rows; ++row) {
    const double a = 2 * std::numbers::pi * row / rows;
    const double around = ring + tube * std::cos(a);
    const int columns = static_cast<int>(2 * std::numbers::pi * around / spacing);
    for (int column = 0; column < columns; ++column) {
      const double b = 2 * std::numbers::pi * (column + 0.5 * (row % 2)) / columns;
      const Vector3f n =
          Eigen::Vector3d{std::cos(a) * std::cos(b), std::cos(a) * std::sin(b), std::sin(a)}.cast<float>();
      const Vector3f p = Eigen::Vector3d{around * std::cos(b), around * std::sin(b), tube * std::sin(a)}.cast<float>();
      if (!seen(p)) continue;
      s.points.push_back(p);
      s.normals.push_back(n);
    }
  }
  return s;
}
float off_torus(const Vector3f& p, float ring, float tube) {
  return std::hypot(std::hypot(p.x(), p.y()) - ring, p.z()) - tube;
}

Completion completed(const Sampled& s, const CompletionOptions& options = {}) {
  auto found = complete_cloud(s.cloud(), options, {}, {});
  EXPECT_TRUE(found) << (found ? "" : found.error().what);
  return found ? std::move(*found) : Completion{};
}

/// A ball of radius 10 with 8,000 samples (spacing .4), less a cap: by the cosine of its rim.
Sampled open_ball(float rim) {
  return sampled_ball({0, 0, 0}, 10, 8000, [rim](const Vector3f& n) { return n.z() < rim; });
}

TEST(Completion, GivesACompleteBallAndTorusNoSample) {
  EXPECT_EQ(completed(sampled_ball({0, 0, 0}, 10, 8000)).samples.size(), 0u);
  EXPECT_EQ(completed(sampled_torus(20, 6, 0.5F, [](const Vector3f&) { return true; })).samples.size(), 0u);
}

// The surface turns over an edge; it does not end there.
TEST(Completion, GivesEdgesNoSample) {
  for (const double degrees : {90.0, 40.0}) {
    // A prism of two faces that meet in an edge, and of what closes it, cut off far away.
    Sampled wedge;
    const double half = degrees * std::numbers::pi / 360;
    std::mt19937 random{11};
    std::uniform_real_distribution<float> jitter{-0.1F, 0.1F};
    for (const float side : {-1.F, 1.F})
      for (int i = 0; i < 40; ++i)
        for (int k = 0; k < 60; ++k) {
          const float along = (static_cast<float>(i) + 0.5F) * 0.5F + jitter(random);
          const float up = (static_cast<float>(k) + 0.5F) * 0.5F + jitter(random);
          const auto c = static_cast<float>(std::cos(half)), s = static_cast<float>(std::sin(half));
          wedge.points.emplace_back(along * c, side * along * s, up);
          wedge.normals.emplace_back(-s, side * c, 0);
        }
    for (const VirtualSample& s : completed(wedge).samples) {
      if (s.point.z() < 2 || s.point.z() > 28) continue;  // the open ends are closed
      EXPECT_GT(std::hypot(s.point.x(), s.point.y()), 1.5F)
          << "at the edge of " << degrees << " degrees, z " << s.point.z();
    }
  }
}

TEST(Completion, FillsAHoleInABallWithinItsBound) {
  const Completion found = completed(open_ball(0.9F));
  ASSERT_GT(found.samples.size(), 100u);
  EXPECT_FALSE(found.too_many || found.too_wide);
  std::size_t within = 0, within_99 = 0;
  for (const VirtualSample& s : found.samples) {
    const float off = std::abs(s.point.norm() - 10);
    within += off <= s.error();
    within_99 += off <= 0.41F * s.gap;
    EXPECT_GT(s.normal.dot(s.point.normalized()), 0.9F);
    EXPECT_NEAR(s.normal.norm(), 1, 1e-4);
  }
  EXPECT_GE(static_cast<double>(within), 0.95 * static_cast<double>(found.samples.size()));
  EXPECT_GE(static_cast<double>(within_99), 0.99 * static_cast<double>(found.samples.size()));
}

// Every place of the cap has a sample, measured or virtual, no farther than three spacings of what lies there.
TEST(Completion, LeavesNoPlaceOfTheHoleWithoutSamples) {
  const Sampled open = open_ball(0.9F);
  const Completion found = completed(open);
  for (const Vector3f& p : sampled_ball({0, 0, 0}, 10, 3000, [](const Vector3f& n) { return n.z() > 0.9F; }).points) {
    float nearest = 1e9F;
    for (const VirtualSample& s : found.samples) nearest = std::min(nearest, (s.point - p).norm() - 2 * s.spacing);
    for (const Vector3f& q : open.points) nearest = std::min(nearest, (q - p).norm() - 1);
    EXPECT_LT(nearest, 0.2F) << p.transpose();
  }
}

TEST(Completion, CarriesATubeAcrossACut) {
  // A tenth of the ring is gone: the tube ends twice.
  const Sampled open = sampled_torus(20, 6, 0.5F, [](const Vector3f& p) { return std::atan2(p.y(), p.x()) < 2.8F; });
  const Completion found = completed(open);
  ASSERT_GT(found.samples.size(), 50u);
  std::size_t within = 0;
  for (const VirtualSample& s : found.samples) within += std::abs(off_torus(s.point, 20, 6)) <= s.error();
  EXPECT_GE(static_cast<double>(within), 0.95 * static_cast<double>(found.samples.size()));
}

TEST(Completion, GapIsTheDistanceToTheNearestMeasuredSample) {
  const Sampled open = open_ball(0.9F);
  const Completion found = completed(open);
  for (const VirtualSample& s : found.samples) {
    float nearest = 1e9F;
    for (const Vector3f& q : open.points) nearest = std::min(nearest, (q - s.point).norm());
    EXPECT_NEAR(s.gap, nearest, 1e-4);
    EXPECT_LE(s.gap, found.largest_gap + 1e-6);
  }
}

TEST(Completion, IsCoarserInTheMiddleOfALargeGap) {
  const Completion found = completed(open_ball(0.3F));
  float finest = 1e9F, coarsest = 0;
  for (const VirtualSample& s : found.samples) {
    finest = std::min(finest, s.spacing);
    coarsest = std::max(coarsest, s.spacing);
  }
  EXPECT_GT(coarsest, 1.7F * finest);
  EXPECT_LT(found.samples.size(), 2500u);
}

TEST(Completion, StopsAtTheGapItMayClose) {
  CompletionOptions options;
  options.most_gap = 1.5;
  const Completion found = completed(open_ball(0.6F), options);
  EXPECT_TRUE(found.too_wide);
  for (const VirtualSample& s : found.samples) EXPECT_LT(s.gap, 2.2F);
}

TEST(Completion, StopsAtTheNumberItMayAdd) {
  CompletionOptions options;
  options.most_share = 0.02;
  const Completion found = completed(open_ball(0.6F), options);
  EXPECT_TRUE(found.too_many);
  EXPECT_LE(found.samples.size(), static_cast<std::size_t>(0.02 * 8000));
}

TEST(Completion, NoiseMakesNoRims) {
  Sampled rough = sampled_ball({0, 0, 0}, 10, 8000);
  std::mt19937 random{5};
  std::normal_distribution<float> bell{0, 0.5F * 0.4F};  // half a spacing
  for (Vector3f& p : rough.points) p *= 1 + bell(random) / 10;
  CompletionOptions options;
  options.noise = 0.5 * 0.4;
  EXPECT_LT(completed(rough, options).samples.size(), 80u);
}

TEST(Completion, GivesTheSameSamplesOnAnyNumberOfThreads) {
  const Sampled open = open_ball(0.8F);
  const auto on = [&](int threads) {
    const tbb::global_control allow{tbb::global_control::max_allowed_parallelism, 8};
    tbb::task_arena arena{threads};
    return arena.execute([&] { return completed(open).samples; });
  };
  const auto one = on(1), eight = on(8);
  EXPECT_TRUE(one == eight);
}

TEST(Completion, CanBeCancelled) {
  std::stop_source source;
  source.request_stop();
  const auto found = complete_cloud(open_ball(0.8F).cloud(), {}, {}, source.get_token());
  ASSERT_FALSE(found);
  EXPECT_EQ(found.error().code, ErrorCode::Cancelled);
}

TEST(Completion, RefusesWhatItCannotUse) {
  const auto code_of = [](const PointCloud& cloud, const CompletionOptions& options) {
    const auto found = complete_cloud(cloud, options, {}, {});
    return found ? ErrorCode::Internal : found.error().code;
  };
  PointCloud bare = open_ball(0.8F).cloud();
  CompletionOptions options;
  options.most_gap = 0;
  EXPECT_EQ(code_of(bare, options), ErrorCode::InvalidInput);
  options = {};
  options.most_share = 0;
  EXPECT_EQ(code_of(bare, options), ErrorCode::InvalidInput);
  options = {};
  options.noise = -1;
  EXPECT_EQ(code_of(bare, options), ErrorCode::InvalidInput);
  options = {};
  options.rounds = 101;
  EXPECT_EQ(code_of(bare, options), ErrorCode::InvalidInput);
  bare.normals.clear();
  EXPECT_EQ(code_of(bare, {}), ErrorCode::InvalidInput);
}

/// Cosine of the half angle that a gap in a torus of radius `ring` takes, of so many tube radii in length.
float gap_in_torus(float ring, float length) { return std::cos(length / ring / 2); }

// Its ends are far apart, but their walls run towards each other.
TEST(Completion, GoesOnWithALimbThatWasCutThrough) {
  const float cut = gap_in_torus(20, 1.8F * 6);
  const Sampled limb =
      sampled_torus(20, 6, 0.5F, [&](const Vector3f& p) { return p.x() < cut * std::hypot(p.x(), p.y()); });
  const Completion found = completed(limb);
  EXPECT_GT(found.samples.size(), 200u);
  for (const VirtualSample& s : found.samples) EXPECT_LT(std::abs(off_torus(s.point, 20, 6)), 2) << s.point.transpose();
}

// More is missing than two radii: the winding number would cap both ends.
TEST(Completion, JoinsTheEndsOfASmoothLimbThatLookAtEachOther) {
  const float cut = gap_in_torus(20, 3.5F * 6);
  const Completion found =
      completed(sampled_torus(20, 6, 0.5F, [&](const Vector3f& p) { return p.x() < cut * std::hypot(p.x(), p.y()); }));
  EXPECT_GT(found.samples.size(), 200u);
  std::size_t within = 0;
  for (const VirtualSample& s : found.samples) {
    within += std::abs(off_torus(s.point, 20, 6)) <= s.error();
    EXPECT_TRUE(s.smooth);
    EXPECT_LT(std::abs(off_torus(s.point, 20, 6)), 1.5F) << s.point.transpose();
  }
  EXPECT_GE(static_cast<double>(within), 0.95 * static_cast<double>(found.samples.size()));
}

/// A tube of radius 6 about z, open at its upper end or at both.
Sampled open_tube(bool below_too) {
  Sampled s;
  for (int row = 0; row < 60; ++row)
    for (int column = 0; column < 75; ++column) {
      const double angle = 2 * std::numbers::pi * (column + 0.5 * (row % 2)) / 75;
      const Vector3f n = Eigen::Vector3d{std::cos(angle), std::sin(angle), 0}.cast<float>();
      s.points.push_back(6 * n + 0.5F * static_cast<float>(row) * Vector3f::UnitZ());
      s.normals.push_back(n);
    }
  if (below_too) return s;
  for (int i = -12; i <= 12; ++i)
    for (int k = -12; k <= 12; ++k)
      if (const Vector3f p = 0.5F * Vector3f(static_cast<float>(i), static_cast<float>(k), -1);
          p.head<2>().norm() < 6) {
        s.points.push_back(p);
        s.normals.push_back(-Vector3f::UnitZ());
      }
  return s;
}

// Nothing tells how far the tube goes on.
TEST(Completion, ClosesAnOpenEndNearItsRim) {
  for (const bool both : {false, true}) {
    const Completion found = completed(open_tube(both));
    EXPECT_GT(found.samples.size(), 50u);
    for (const VirtualSample& s : found.samples) {
      EXPECT_LT(s.point.z(), 29.5F + 9) << s.point.transpose();
      EXPECT_GT(s.point.z(), -9) << s.point.transpose();
    }
  }
}

/// Its samples moved across the surface, by this much in the mean square.
Sampled roughened(Sampled s, float by) {
  std::mt19937 random{7};
  std::normal_distribution<float> bell{0, by};
  for (std::size_t i = 0; i < s.points.size(); ++i) s.points[i] += bell(random) * s.normals[i];
  return s;
}

TEST(Completion, TakesASmoothFunctionOnlyWhereItForetellsWhatWasMeasured) {
  const auto smooth_share = [](const Sampled& s) {
    const auto samples = completed(s).samples;
    EXPECT_GT(samples.size(), 100u);
    const auto smooth = std::count_if(samples.begin(), samples.end(), [](const VirtualSample& v) { return v.smooth; });
    return static_cast<double>(smooth) / static_cast<double>(samples.size());
  };
  EXPECT_GT(smooth_share(open_ball(0.8F)), 0.9);
  EXPECT_EQ(smooth_share(roughened(open_ball(0.8F), 0.12F)), 0);
}

WindingTree tree_of(const Sampled& measured, const Completion& completion) {
  std::vector<Vector3f> points = measured.points, normals = measured.normals;
  std::vector<float> areas = completion.areas;
  for (const VirtualSample& s : completion.samples) {
    points.push_back(s.point);
    normals.push_back(s.normal);
    areas.push_back(s.spacing * s.spacing);
  }
  return {points, normals, areas};
}

TEST(FacingPairs, AreTheEndsOfALimbThatMayBeOne) {
  const float cut = gap_in_torus(20, 3.5F * 6);
  // Too rough for a smooth function to join them.
  const Sampled limb = roughened(
      sampled_torus(20, 6, 0.5F, [&](const Vector3f& p) { return p.x() < cut * std::hypot(p.x(), p.y()); }), 0.1F);
  const Completion found = completed(limb);
  const auto pairs = facing_pairs(found.samples, tree_of(limb, found), 1.5F);
  EXPECT_GT(pairs.size(), 20u);
  for (const FacingPair& pair : pairs) {
    EXPECT_LT(pair.from.y() * pair.to.y(), 0);
    EXPECT_GT(pair.from.x(), 0);
  }
}

TEST(FacingPairs, AreNoneInAHoleOfOneFace) {
  const Sampled torn = open_ball(0.9F);
  const Completion found = completed(torn);
  ASSERT_GT(found.samples.size(), 20u);
  EXPECT_TRUE(facing_pairs(found.samples, tree_of(torn, found), 1.5F).empty());
}

}  // namespace
}  // namespace telefab::scan
