// SPDX-License-Identifier: GPL-3.0-or-later
#include "coverage.hpp"

#include <gtest/gtest.h>

#include <telefab/scan/contour/grid_tracer.hpp>
#include <telefab/test/analytic_field.hpp>
#include <telefab/test/surface_samples.hpp>

namespace telefab::scan {
namespace {

constexpr double kRadiusMm = 10;

/// A ball's equator held against its samples near it, and against others that lie off it.
class CoverageOfABall : public testing::Test {
 protected:
  CoverageOfABall() {
    const auto samples = test::sample_surface(*ball_, {.spacing_mm = 0.8, .seed = 4});
    all_.points = samples.points;
    all_.normals = samples.normals;
  }

  void add_stray(const Vec3& place) {
    all_.points.push_back(place);
    all_.normals.push_back(Vec3::UnitX());
  }
  [[nodiscard]] SurfaceSamples between(double low, double high) const {
    SurfaceSamples found;
    for (std::size_t i = 0; i < all_.points.size(); ++i)
      if (all_.points[i].z() >= low && all_.points[i].z() <= high) {
        found.points.push_back(all_.points[i]);
        found.normals.push_back(all_.normals[i]);
      }
    return found;
  }
  [[nodiscard]] Coverage covered(bool knows_all = true) const {
    const auto cursor = ball_->cursor();
    const SurfaceSamples near = between(-0.5, 0.5);
    const auto trace = trace_by_grid(*ball_, *cursor, 0, {near.points, near.normals}, {}, {});
    const SampleSource source = [this](double low, double high, SurfaceSamples& found) { found = between(low, high); };
    return coverage_of(*ball_, *cursor, 0, trace->contours, near, 0.75, 0, knows_all ? source : SampleSource{});
  }

  test::Shape ball_ = test::sphere(kRadiusMm, 1);
  SurfaceSamples all_;
};

TEST_F(CoverageOfABall, LeavesNoSampleOfItsOwnOver) {
  EXPECT_EQ(covered().lost, 0U);
  EXPECT_EQ(covered().unexplained, 0U);
}

TEST_F(CoverageOfABall, DoesNotCountALoneStray) {
  add_stray({kRadiusMm + 3, 0, 0.1});
  EXPECT_EQ(covered().unexplained, 0U);
  EXPECT_EQ(covered(false).unexplained, 1U);
}

TEST_F(CoverageOfABall, CountsStraysThatMayBeAFeature) {
  add_stray({kRadiusMm + 3, 0, 0.1});
  add_stray({kRadiusMm + 3, 0.8, -0.2});
  EXPECT_EQ(covered().unexplained, 2U);
}

TEST_F(CoverageOfABall, CountsTheOneSampleNearThePlaneOfAPinThatRunsThroughIt) {
  for (const double z : {-4.0, -2.0, 0.0, 2.0, 4.0}) add_stray({kRadiusMm + 3, 0, z});
  EXPECT_EQ(covered().unexplained, 1U);
}

}  // namespace
}  // namespace telefab::scan
