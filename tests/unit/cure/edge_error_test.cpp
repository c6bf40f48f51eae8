// SPDX-License-Identifier: GPL-3.0-or-later
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <numbers>
#include <telefab/fab/cure/edge_error.hpp>
#include <telefab/fab/cure/edge_points.hpp>
#include <telefab/fab/mask/raster.hpp>
#include <telefab/test/mask_shapes.hpp>

#include "lit_plates.hpp"

namespace telefab::fab::test {
namespace {

using telefab::test::binary_mask;
using telefab::test::exposed;
using telefab::test::judge;
using telefab::test::judge_machine;
using telefab::test::kept_width;
using telefab::test::mask_shapes;
using telefab::test::thin_features;
using testing::HasSubstr;

Contour rectangle_px(double x0, double y0, double x1, double y1) {
  const auto mm = [](double x, double y) { return Point2{0.05 * x, 0.05 * y}; };
  return Contour::from_vertices({mm(x0, y0), mm(x1, y0), mm(x1, y1), mm(x0, y1)}).value();
}

class EdgeErrorTest : public testing::Test {
 protected:
  MachineProfile machine = judge_machine(0.5);
  /// Pixels 20 to 60 of both axes.
  DoseField block = exposed(machine,
                            mask_of(machine.mask_size(),
                                    [](int c, int r) {
                                      const int y = 95 - r;
                                      return c >= 20 && c < 60 && y >= 20 && y < 60 ? 255 : 0;
                                    }),
                            0.5);
};

TEST_F(EdgeErrorTest, IsNothingWhereTheEdgeMeetsItsContour) {
  const Contour target = rectangle_px(20, 20, 60, 60);
  const EdgeFigures figures = measure_edges(block, 1, {{&target, 1}, {}}, 0.05, {}).value();
  EXPECT_LT(figures.smooth.max_px(), 1e-4);
  EXPECT_EQ(figures.edges.count(), 320);
  EXPECT_EQ(figures.corners.count(), 4);
  // At a corner the product of two straight edges is a half: phi(t / 0.5)^2 = 1/2.
  EXPECT_NEAR(figures.corners.mean_px(), 0.5 * 0.5451 * std::numbers::sqrt2, 1e-3);
  EXPECT_LT(figures.corners.bias_px(), 0);
  EXPECT_EQ(figures.lost, 0);
  EXPECT_NEAR(figures.target_px2, 1600, 1e-9);
  EXPECT_EQ(figures.far_px2, 0);
  // A straight edge falls by 1 / (sigma sqrt(2 pi)) of white a pixel.
  EXPECT_NEAR(figures.latitude_px(), 0.01 * 0.5 * 0.5 * std::sqrt(2 * std::numbers::pi), 5e-4);
}

TEST_F(EdgeErrorTest, HasTheSignAndSizeOfAShift) {
  const Contour narrow = rectangle_px(20.3, 20.3, 59.7, 59.7), wide = rectangle_px(19.6, 19.6, 60.4, 60.4);
  const EdgeFigures grown = measure_edges(block, 1, {{&narrow, 1}, {}}, 0.05, {}).value();
  EXPECT_NEAR(grown.smooth.bias_px(), 0.3, 1e-3);
  EXPECT_NEAR(grown.smooth.percentile_px(0.5), 0.3, 1.0 / 128);
  EXPECT_NEAR(grown.excess_px2, 1600 - 39.4 * 39.4, 35);
  EXPECT_EQ(grown.missing_px2, 0);
  const EdgeFigures shrunk = measure_edges(block, 1, {{&wide, 1}, {}}, 0.05, {}).value();
  EXPECT_NEAR(shrunk.smooth.bias_px(), -0.4, 1e-3);
  EXPECT_EQ(shrunk.excess_px2, 0);
  EXPECT_NEAR(shrunk.cured.mean_px(), 0.4, 0.02);
}

TEST_F(EdgeErrorTest, CountsLostEdgesAndWhatIsCuredOrMissingFarAway) {
  const Contour elsewhere = rectangle_px(70, 70, 80, 80);
  const EdgeFigures figures = measure_edges(block, 1, {{&elsewhere, 1}, {}}, 0.05, {}).value();
  EXPECT_EQ(figures.lost_share(), 1);
  EXPECT_EQ(figures.edges.mean_px(), 1.5);
  EXPECT_NEAR(figures.far_px2, 1600 + 64, 6);
  EXPECT_NEAR(figures.missing_px2, 100, 1e-9);
  const EdgeFigures nothing = measure_edges(block, 1, {}, 0.05, {}).value();
  EXPECT_EQ(nothing.edges.count(), 0);
  EXPECT_EQ(nothing.edges.mean_px(), 0);
  EXPECT_NEAR(nothing.far_px2, 1600, 6);
}

TEST_F(EdgeErrorTest, HolesAreEdgesToo) {
  const Mask ring = mask_of(machine.mask_size(), [](int c, int r) {
    const auto in = [](int v, int a, int b) { return v >= a && v < b; };
    return in(c, 20, 60) && in(r, 20, 60) && !(in(c, 30, 40) && in(r, 30, 40)) ? 255 : 0;
  });
  std::vector<Contour> target{rectangle_px(20, 36, 60, 76)};
  const Contour outer = rectangle_px(30, 56, 40, 66);
  target.push_back(Contour::from_vertices({outer.vertices().rbegin(), outer.vertices().rend()}).value());
  const EdgeFigures figures = measure_edges(exposed(machine, ring, 0.5), 1, {target, {}}, 0.05, {}).value();
  EXPECT_LT(figures.smooth.max_px(), 1e-4);
  EXPECT_NEAR(figures.target_px2, 1500, 1e-9);
  EXPECT_EQ(figures.corners.count(), 8);
}

TEST_F(EdgeErrorTest, JudgesNoEdgeWhereSomethingJoins) {
  const Contour part = rectangle_px(20, 20, 60, 40);
  const EdgeFigures alone = measure_edges(block, 1, {{&part, 1}, {}}, 0.05, {}).value();
  EXPECT_GT(alone.lost, 30);
  const Contour rest = rectangle_px(20, 40, 60, 60);
  const EdgeFigures joined = measure_edges(block, 1, {{&part, 1}, {&rest, 1}}, 0.05, {}).value();
  EXPECT_EQ(joined.lost, 0);
  EXPECT_LT(joined.smooth.max_px(), 1e-4);
  EXPECT_NEAR(joined.edges.count(), 2 * (40 + 20 + 20) - 3 * 4, 6);
  EXPECT_NEAR(joined.excess_px2, 0, 1);
}

TEST_F(EdgeErrorTest, RefusesOptionsOutOfRange) {
  EdgeOptions options;
  options.sample_px = 0;
  EXPECT_THAT(measure_edges(block, 1, {}, 0.05, options).error().what, HasSubstr("0.05 to 10"));
  options = {};
  options.sub_pixels = 17;
  EXPECT_FALSE(measure_edges(block, 1, {}, 0.05, options));
  options = {};
  options.lost_px = 4;
  EXPECT_FALSE(measure_edges(block, 1, {}, 0.05, options));
}

TEST(EdgePoints, OfADiscLieOnItAndPointOutwards) {
  const MachineProfile machine = judge_machine(0.5);
  std::vector<Point2> places;
  for (int i = 0; i < 400; ++i) {
    const double a = 2 * std::numbers::pi * i / 400;
    places.push_back({0.05 * (48.2 + 20 * std::cos(a)), 0.05 * (47.7 + 20 * std::sin(a))});
  }
  const Contour disc = Contour::from_vertices(places).value();
  const DoseField field = exposed(machine, rasterise({&disc, 1}, mask_frame(machine)), 0.5);
  const auto points = edge_points(field, 1, 4, 1);
  // Every line of 40 meets the circle twice, on both axes.
  EXPECT_NEAR(static_cast<double>(points.size()), 160, 2);
  for (const EdgePoint& p : points) {
    const double x = p.place.x_px - 48.2, y = p.place.y_px - 47.7, r = std::hypot(x, y);
    EXPECT_NEAR(r, 20, 0.1);
    EXPECT_GT((x * p.normal_x + y * p.normal_y) / r, 0.95);
    EXPECT_NEAR(field.sample(p.place).dose, 1, 1e-4);
  }
}

// The judge against figures of an independent study of the same model (the shapes there are similar, not the same).
TEST(Judge, FindsTheKnownErrorsOfCoverAndOfBinaryMasks) {
  const MachineProfile machine = judge_machine(0.5);
  EdgeFigures cover, binary;
  for (const auto& shape : mask_shapes()) {
    cover.add(judge(machine, rasterise(shape.rings, mask_frame(machine)), 0.5, shape.rings));
    binary.add(judge(machine, binary_mask(machine, shape.rings), 0.5, shape.rings));
  }
  EXPECT_NEAR(cover.edges.mean_px(), 0.093, 0.02);
  EXPECT_NEAR(cover.smooth.mean_px(), 0.032, 0.01);
  EXPECT_NEAR(cover.corners.mean_px(), 0.60, 0.1);
  EXPECT_NEAR(cover.latitude_px(), 0.009, 0.002);
  EXPECT_NEAR(binary.edges.mean_px(), 0.221, 0.02);
  EXPECT_NEAR(binary.smooth.mean_px(), 0.182, 0.02);
  EXPECT_EQ(cover.far_px2, 0);
}

TEST(Judge, FindsThatCoverLosesWallsOfAPixelAndKeepsTwo) {
  const MachineProfile machine = judge_machine(0.5);
  for (const bool gaps : {false, true}) {
    double least_thin = 9, least = 9, most = 0;
    for (const auto& f : thin_features(1, gaps))
      least_thin = std::min(least_thin,
                            kept_width(exposed(machine, rasterise(f.rings, mask_frame(machine)), 0.5), 1, f).least_px);
    for (const auto& f : thin_features(2, gaps)) {
      const auto kept = kept_width(exposed(machine, rasterise(f.rings, mask_frame(machine)), 0.5), 1, f);
      least = std::min(least, kept.least_px);
      most = std::max(most, kept.most_px);
    }
    EXPECT_EQ(least_thin, 0);
    EXPECT_NEAR(least, 1.95, 0.02);
    EXPECT_NEAR(most, 2.05, 0.02);
  }
}

}  // namespace
}  // namespace telefab::fab::test
