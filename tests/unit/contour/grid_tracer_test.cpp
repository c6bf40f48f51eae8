// SPDX-License-Identifier: GPL-3.0-or-later
#include <gtest/gtest.h>

#include <cmath>
#include <numbers>
#include <random>
#include <telefab/scan/contour/grid_tracer.hpp>
#include <telefab/test/surface_samples.hpp>

namespace telefab::test {
namespace {

using scan::GridOptions;
using scan::LayerTrace;

/// Traces the slice from samples within a kernel width of the plane.
LayerTrace traced(const AnalyticField& shape, const SurfaceSamples& all, double z_mm, const GridOptions& options = {}) {
  SurfaceSamples near;
  const double band = shape.kernel_width_mm({0, 0, z_mm});
  for (std::size_t i = 0; i < all.points.size(); ++i)
    if (std::abs(all.points[i].z() - z_mm) < band) {
      near.points.push_back(all.points[i]);
      near.normals.push_back(all.normals[i]);
    }
  const auto cursor = shape.cursor();
  auto trace = trace_by_grid(shape, *cursor, z_mm, {near.points, near.normals}, options, {});
  EXPECT_TRUE(trace) << trace.error().what;
  return std::move(*trace);
}

TEST(GridTracer, FindsTheOutersAndHolesOfTheExactSlice) {
  for (const Shape& shape : {bumpy(20, 0.7), torus(20, 8, 35, 1), genus_two(20, 1), hollow_sphere(20, 5, 1),
                             bowl(15, 3, 0.8), near_touching_balls(15, 1.5, 0.7), thin_wall(30, 20, 2, 0.6),
                             bored_plate(3, 6, 1, 0.7), stepped_box(20, 1.5, 0.8)}) {
    const SurfaceSamples samples = sample_surface(*shape, {.spacing_mm = 0.8});
    int judged = 0;
    for (int i = -4; i <= 4; ++i) {
      const double z = 4.337 * i + 0.21;
      const SliceCount truth = count_slice(*shape, z, 0.25);
      // Next to a critical height the two grids may differ.
      if (truth != count_slice(*shape, z - 0.2, 0.25) || truth != count_slice(*shape, z + 0.2, 0.25)) continue;
      ++judged;
      const LayerTrace layer = traced(*shape, samples, z);
      EXPECT_TRUE(layer.faults.empty()) << shape->facts().name << " z " << z << ": " << name_of(layer.faults[0].reason);
      EXPECT_EQ(layer.euler(), truth.euler()) << shape->facts().name << " z " << z;
      EXPECT_EQ(static_cast<int>(layer.contours.size()), truth.outers + truth.holes)
          << shape->facts().name << " z " << z;
    }
    EXPECT_GT(judged, 1) << shape->facts().name;
  }
}

TEST(GridTracer, FindsTheExactSliceOfShapesTurnedAnyWay) {
  std::mt19937_64 random{20};
  std::uniform_real_distribution<double> uniform{-1, 1};
  int judged = 0;
  for (int round = 0; round < 12; ++round) {
    const Pose pose = Pose::turned(180 * uniform(random), {uniform(random), uniform(random), uniform(random)});
    const Shape shape = round % 2 ? genus_two(15, 0.8, pose) : two_bumps(15, 0.8, pose);
    const SurfaceSamples samples =
        sample_surface(*shape, {.spacing_mm = 0.7, .seed = static_cast<std::uint64_t>(round + 1)});
    for (int k = 0; k < 4; ++k) {
      const double z = 12 * uniform(random);
      const SliceCount truth = count_slice(*shape, z, 0.25);
      if (truth != count_slice(*shape, z - 0.2, 0.25) || truth != count_slice(*shape, z + 0.2, 0.25)) continue;
      ++judged;
      const LayerTrace layer = traced(*shape, samples, z);
      EXPECT_TRUE(layer.faults.empty()) << "round " << round << " z " << z;
      EXPECT_EQ(layer.euler(), truth.euler()) << "round " << round << " z " << z;
    }
  }
  EXPECT_GT(judged, 20);
}

TEST(GridTracer, KeepsTheChordToleranceAndEveryVertexOnTheSurface) {
  const Shape ball = sphere(20, 1);
  const SurfaceSamples samples = sample_surface(*ball, {.spacing_mm = 0.8});
  for (const double chord_mm : {0.002, 0.01, 0.05}) {
    const LayerTrace layer = traced(*ball, samples, 12, {.chord_mm = chord_mm});
    ASSERT_EQ(layer.contours.size(), 1U);
    const auto vertices = layer.contours[0].vertices();
    for (std::size_t i = 0; i < vertices.size(); ++i) {
      const Point2 a = vertices[i];
      const Point2 b = vertices[(i + 1) % vertices.size()];
      EXPECT_NEAR(std::hypot(a.x_mm, a.y_mm), 16, 0.1 * chord_mm);
      EXPECT_GT(std::hypot(0.5 * (a.x_mm + b.x_mm), 0.5 * (a.y_mm + b.y_mm)), 16 - 1.1 * chord_mm);
    }
  }
}

TEST(GridTracer, LeavesAContourOutThatDoesNotCloseAndSaysWhere) {
  const Shape open = gapped(sphere(20, 1), {20, 0, 0}, 2);
  const SurfaceSamples samples = sample_surface(*open, {.spacing_mm = 0.8, .holes = {{{20, 0, 0}, 2}}});
  const LayerTrace layer = traced(*open, samples, 0, {});
  EXPECT_TRUE(layer.contours.empty());
  ASSERT_EQ(layer.gaps.size(), 1U);
  EXPECT_FALSE(layer.gaps[0].bridged);
  EXPECT_NEAR(layer.gaps[0].size_mm, 4, 1.1);  // the hole and at most half a kernel width at each side
  EXPECT_NEAR(layer.gaps[0].place.x_mm, 20, 0.3);
  ASSERT_EQ(layer.faults.size(), 1U);
  EXPECT_EQ(layer.faults[0].reason, DoubtReason::ContoursLeftOut);
}

TEST(GridTracer, RefusesOptionsWithoutMeaning) {
  for (const GridOptions& bad : {GridOptions{.chord_mm = 0}, GridOptions{.chord_mm = 2},
                                 GridOptions{.pitch_kernels = 0}, GridOptions{.pitch_kernels = 2}})
    EXPECT_FALSE(bad.validate());
}

TEST(GridTracer, StopsWhenAsked) {
  const Shape ball = sphere(20, 1);
  const SurfaceSamples samples = sample_surface(*ball, {.spacing_mm = 2});
  const auto cursor = ball->cursor();
  std::stop_source stop;
  stop.request_stop();
  EXPECT_EQ(trace_by_grid(*ball, *cursor, 0, {samples.points, samples.normals}, {}, stop.get_token()).error().code,
            ErrorCode::Cancelled);
}

}  // namespace
}  // namespace telefab::test
