// SPDX-License-Identifier: GPL-3.0-or-later
#include <gtest/gtest.h>

#include <numbers>
#include <telefab/scan/measure/contour_deviation.hpp>

namespace telefab::scan {
namespace {

Contour circle(double x_mm, double radius_mm, int corners = 720) {
  std::vector<Point2> v;
  for (int k = 0; k < corners; ++k) {
    const double angle = 2 * std::numbers::pi * k / corners;
    v.push_back({x_mm + radius_mm * std::cos(angle), 20 + radius_mm * std::sin(angle)});
  }
  return Contour::from_vertices(std::move(v)).value();
}

std::vector<Layer> stack_of(std::vector<std::vector<Contour>> rings) {
  std::vector<Layer> layers;
  for (auto& of_layer : rings) {
    Layer layer;
    layer.index = LayerIndex{static_cast<std::uint32_t>(layers.size())};
    layer.contours = std::move(of_layer);
    layers.push_back(std::move(layer));
  }
  return layers;
}

TEST(ContourDeviation, IsTheDistanceBetweenConcentricCircles) {
  const auto a = stack_of({{circle(20, 10)}, {circle(20, 10)}}),
             b = stack_of({{circle(20, 10.03)}, {circle(20, 9.97)}});
  const auto d = measure_contours(a, b, {}, {});
  ASSERT_TRUE(d) << d.error().what;
  EXPECT_NEAR(d->mean_mm, 0.03, 2e-4);
  EXPECT_NEAR(d->p95_mm, 0.03, 4e-4);
  EXPECT_NEAR(d->max_mm, 0.03, 6e-4);
  EXPECT_EQ(d->other_counts, 0U);
  EXPECT_EQ(d->layers, 2U);
}

TEST(ContourDeviation, LooksBothWaysSoThatALostRingIsSeen) {
  const auto whole = stack_of({{circle(20, 10), circle(60, 10)}}), lacking = stack_of({{circle(20, 10)}});
  for (const auto& [reference, built] : {std::pair{whole, lacking}, std::pair{lacking, whole}}) {
    const auto d = measure_contours(reference, built, {}, {});
    ASSERT_TRUE(d);
    EXPECT_EQ(d->max_mm, 1);  // no counterpart: the most
    EXPECT_EQ(d->other_counts, 1U);
    EXPECT_NEAR(d->mean_mm, 1.0 / 3, 0.01);  // one ring in three that are looked from
  }
}

TEST(ContourDeviation, FindsTheNearestEdgeAmongAllAtAnyPlace) {
  // Long edges at an angle to the cells, against the plain search.
  const auto star =
      Contour::from_vertices(
          {{0, 0}, {30.3, 7.1}, {60.7, 1.3}, {44.2, 20.9}, {58.1, 41.7}, {29.9, 30.2}, {2.2, 39.6}, {17.4, 19.1}})
          .value();
  const ContourEdges edges{std::array{star}, 1};
  int near = 0;
  for (double x = -3; x < 64; x += 0.37)
    for (double y = -3; y < 45; y += 0.41) {
      double best = 1;
      const auto v = star.vertices();
      for (std::size_t i = 0; i < v.size(); ++i) {
        const Point2 a = v[i], b = v[(i + 1) % v.size()];
        const double dx = b.x_mm - a.x_mm, dy = b.y_mm - a.y_mm;
        const double t = std::clamp(((x - a.x_mm) * dx + (y - a.y_mm) * dy) / (dx * dx + dy * dy), 0.0, 1.0);
        best = std::min(best, std::hypot(x - a.x_mm - t * dx, y - a.y_mm - t * dy));
      }
      near += best < 1;
      ASSERT_NEAR(edges.distance_mm({x, y}), best, 1e-12) << x << ' ' << y;
    }
  EXPECT_GT(near, 500);
}

TEST(ContourDeviation, RefusesStacksOfOtherHeights) {
  const auto d = measure_contours(stack_of({{circle(20, 10)}}), stack_of({{circle(20, 10)}, {}}), {}, {});
  ASSERT_FALSE(d);
  EXPECT_EQ(d.error().code, ErrorCode::InvalidInput);
}

}  // namespace
}  // namespace telefab::scan
