// SPDX-License-Identifier: GPL-3.0-or-later
#include <gtest/gtest.h>

#include <cmath>
#include <telefab/scan/contour/reeb_marcher.hpp>
#include <telefab/scan/topology/height_topology.hpp>
#include <telefab/test/surface_samples.hpp>

namespace telefab::test {
namespace {

using scan::march_contours;
using scan::MarchedLayer;
using scan::MarchOptions;
using scan::SampleView;

MarchedLayer marched(const AnalyticField& shape, double z_mm, const std::vector<Vec3>& seeds,
                     const MarchOptions& options = {}, const SampleView& near_plane = {}) {
  const auto cursor = shape.cursor();
  auto layer = march_contours(shape, *cursor, z_mm, seeds, near_plane, options, {});
  EXPECT_TRUE(layer) << layer.error().what;
  return std::move(*layer);
}

/// Largest distance of vertices and of points on the chords to the exact contour, to first order.
std::pair<double, double> deviation(const AnalyticField& shape, const MarchedLayer& layer, double z_mm) {
  const auto cursor = shape.cursor();
  double vertex = 0, chord = 0;
  const auto off = [&](double x, double y) {
    const auto f = cursor->at({x, y, z_mm});
    return std::abs(f.value_mm) / f.gradient.head<2>().norm();
  };
  for (const Contour& c : layer.contours)
    for (std::size_t i = 0; i < c.vertices().size(); ++i) {
      const Point2 a = c.vertices()[i];
      const Point2 b = c.vertices()[(i + 1) % c.vertices().size()];
      vertex = std::max(vertex, off(a.x_mm, a.y_mm));
      for (const double share : {0.25, 0.5, 0.75})
        chord = std::max(chord, off(a.x_mm + share * (b.x_mm - a.x_mm), a.y_mm + share * (b.y_mm - a.y_mm)));
    }
  return {vertex, chord};
}

TEST(ReebMarcher, ACircleHasThePapersStepAndClosesOnce) {
  const Shape ball = sphere(20, 1);
  const MarchedLayer layer = marched(*ball, 12, {{16, 0, 12}}, {.chord_mm = 0.01});
  ASSERT_EQ(layer.contours.size(), 1u);
  EXPECT_TRUE(layer.problems.empty());
  EXPECT_NEAR(layer.contours[0].signed_area_mm2(), 3.14159265 * 256, 1.5);
  // 2 sqrt(2 r ds - ds^2) = 1.131 mm: 88.9 chords.
  EXPECT_GE(layer.contours[0].vertices().size(), 88u);
  EXPECT_LE(layer.contours[0].vertices().size(), 105u);
  EXPECT_LT(static_cast<double>(layer.evaluations) / static_cast<double>(layer.contours[0].vertices().size()), 2.5);
  const auto [vertex, chord] = deviation(*ball, layer, 12);
  EXPECT_LT(vertex, 0.0003);
  EXPECT_LT(chord, 0.0105);
}

TEST(ReebMarcher, HoldsTheChordOnEveryShapeAndScale) {
  for (const double ds : {0.002, 0.01, 0.05}) {
    for (const Shape& shape : {bumpy(20, 0.7), gyroid_ball(20, 16, 1), torus(20, 8, 35, 1), genus_two(20, 1)}) {
      const SurfaceSamples samples = sample_surface(*shape, {.spacing_mm = 1});
      const auto topology = scan::analyse_height(*shape, {samples.points, samples.normals}, {}, {}).value();
      for (int i = -4; i <= 4; ++i) {
        const double z = 3.917 * i + 0.21;
        if (topology.is_near_critical(z)) continue;
        std::vector<Vec3> seeds;
        for (const auto& s : topology.seeds(z)) seeds.push_back(s.point_mm);
        const MarchedLayer layer = marched(*shape, z, seeds, {.chord_mm = ds});
        EXPECT_TRUE(layer.problems.empty()) << shape->facts().name << " z " << z << " ds " << ds;
        const auto count = topology.predicted_contours(z).value();
        EXPECT_EQ(static_cast<int>(layer.contours.size()), count.outers + count.holes)
            << shape->facts().name << " z " << z << " ds " << ds;
        const auto [vertex, chord] = deviation(*shape, layer, z);
        EXPECT_LT(vertex, 0.1 * ds) << shape->facts().name << " z " << z;
        EXPECT_LT(chord, 2 * ds) << shape->facts().name << " z " << z;
      }
    }
  }
}

TEST(ReebMarcher, RingsHaveTheSolidOnTheLeft) {
  const Shape shell = hollow_sphere(20, 5, 1);
  const MarchedLayer layer = marched(*shell, 0.5, {{20, 0, 0.5}, {0, 15, 0.5}});
  ASSERT_EQ(layer.contours.size(), 2u);
  EXPECT_FALSE(layer.contours[0].is_hole());
  EXPECT_TRUE(layer.contours[1].is_hole());
}

TEST(ReebMarcher, TwoSeedsOnOneContourGiveItOnce) {
  const Shape ball = sphere(20, 1);
  EXPECT_EQ(marched(*ball, 0, {{20, 0, 0}, {0, 20.3, 0}, {-20, 0.2, 0}}).contours.size(), 1u);
}

TEST(ReebMarcher, ASeedOffTheSurfaceIsReportedWithItsPlace) {
  const Shape ball = sphere(20, 1);
  const MarchedLayer layer = marched(*ball, 0, {{1, 2, 0}});
  EXPECT_TRUE(layer.contours.empty());
  ASSERT_EQ(layer.problems.size(), 1u);
  EXPECT_EQ(layer.problems[0].kind, scan::MarchProblem::Kind::SeedOffSurface);
  EXPECT_EQ(layer.problems[0].place, (Point2{1, 2}));
}

TEST(ReebMarcher, CoverageFindsTheContourNoSeedLedTo) {
  const Shape pair = near_touching_balls(15, 1.5, 1);
  const SurfaceSamples all = sample_surface(*pair, {.spacing_mm = 0.7});
  SurfaceSamples near;
  for (std::size_t i = 0; i < all.points.size(); ++i)
    if (std::abs(all.points[i].z() - 1) < 0.5) {
      near.points.push_back(all.points[i]);
      near.normals.push_back(all.normals[i]);
    }
  const SampleView band{near.points, near.normals};
  const double x_left = near.points.front().x() < 0 ? near.points.front().x() : 0;
  const MarchedLayer none = marched(*pair, 1, {}, {}, band);
  EXPECT_EQ(none.contours.size(), 2u);
  EXPECT_EQ(none.from_coverage, 2u);
  const MarchedLayer left = marched(*pair, 1, {{x_left, near.points.front().y(), 1}});
  ASSERT_LE(left.contours.size(), 1u);
  EXPECT_FALSE(uncovered_samples(*pair, 1, left.contours, band, 0.5).empty());
  EXPECT_TRUE(uncovered_samples(*pair, 1, none.contours, band, 0.5).empty());
}

TEST(ReebMarcher, AnOpenContourIsFollowedFewTimesHoweverManySamplesLieBesideIt) {
  const Shape ball = sphere(20, 1);
  const Shape open = gapped(sphere(20, 1), {20, 0, 0}, 2);
  const SurfaceSamples all = sample_surface(*ball, {.spacing_mm = 0.3});
  SurfaceSamples near;
  for (std::size_t i = 0; i < all.points.size(); ++i)
    if (std::abs(all.points[i].z()) < 0.4 && (all.points[i] - Vec3{20, 0, 0}).norm() > 2) {
      near.points.push_back(all.points[i]);
      near.normals.push_back(all.normals[i]);
    }
  ASSERT_GT(near.points.size(), 500u);
  const auto whole = marched(*ball, 0, {{20, 0, 0}});
  const auto cursor = open->cursor();
  const auto layer = march_contours(*open, *cursor, 0, {}, {near.points, near.normals}, {}, {}).value();
  EXPECT_TRUE(layer.contours.empty());
  ASSERT_FALSE(layer.problems.empty());
  EXPECT_EQ(layer.problems[0].kind, scan::MarchProblem::Kind::Open);
  EXPECT_NEAR(layer.problems[0].place.y_mm, -2, 0.1);
  EXPECT_LT(layer.evaluations, 20 * whole.evaluations);
}

TEST(ReebMarcher, EndsWithinItsEvaluationsAndSaysSo) {
  const Shape ball = sphere(20, 1);
  const auto whole = marched(*ball, 0, {{20, 0, 0}});
  const auto half = marched(*ball, 0, {{20, 0, 0}}, {.most_evaluations = whole.evaluations / 2});
  EXPECT_TRUE(half.contours.empty());
  ASSERT_FALSE(half.problems.empty());
  EXPECT_LT(half.evaluations, whole.evaluations / 2 + 50);
  const auto two = marched(*ball, 0, {{20, 0, 0}, {-20, 0, 0}}, {.most_evaluations = 1});
  EXPECT_EQ(two.problems.back().kind, scan::MarchProblem::Kind::TooLong);
}

TEST(ReebMarcher, RefusesOptionsWithoutMeaning) {
  const Shape ball = sphere(20, 1);
  const auto cursor = ball->cursor();
  for (const MarchOptions& bad :
       {MarchOptions{.chord_mm = 0}, MarchOptions{.longest_step_kernels = 5}, MarchOptions{.pick_kernels = 0},
        MarchOptions{.seed_reach_kernels = 0}, MarchOptions{.max_vertices = 3}})
    EXPECT_EQ(march_contours(*ball, *cursor, 0, {}, {}, bad, {}).error().code, ErrorCode::InvalidInput);
}

TEST(ReebMarcher, StopsWhenAsked) {
  const Shape ball = sphere(20, 1);
  const auto cursor = ball->cursor();
  std::stop_source stop;
  stop.request_stop();
  const std::vector<Vec3> seeds{{20, 0, 0}};
  EXPECT_EQ(march_contours(*ball, *cursor, 0, seeds, {}, {}, stop.get_token()).error().code, ErrorCode::Cancelled);
}

}  // namespace
}  // namespace telefab::test
