// SPDX-License-Identifier: GPL-3.0-or-later
// Scans with more points than are taken.
#include <gmock/gmock.h>

#include <algorithm>
#include <cmath>

#include "sliced.hpp"

namespace telefab::scan {
namespace {

constexpr double kRing = 9, kTube = 4;

/// Some 70,000 points, .14 mm apart; a pixel of the machine is .1 mm wide.
const std::string& dense_text() {
  static const std::string text =
      text_of(test::sample_surface(*test::torus(kRing, kTube, 90, 1), {.spacing_mm = 0.14, .seed = 11}));
  return text;
}

/// Largest distance of a vertex to the torus, which stands upright.
double farthest_off(const Outcome& outcome) {
  const Transform4& placed = outcome.report->header.scan_to_build;
  double farthest = 0;
  for (const Layer& layer : outcome.layers)
    for (const Contour& ring : layer.contours)
      for (const Point2& p : ring.vertices()) {
        const Vec3 at = Vec3{p.x_mm, p.y_mm, layer.z_mm} - Vec3{placed[3], placed[7], placed[11]};
        // The axis of the ring lies in the plane: which way, the size says.
        const bool along_x = outcome.report->size_mm[0] < outcome.report->size_mm[1];
        const double axis = along_x ? at.x() : at.y(), across = along_x ? at.y() : at.x();
        const double from_ring = std::hypot(across, at.z()) - kRing;
        farthest = std::max(farthest, std::abs(std::hypot(from_ring, axis) - kTube));
      }
  return farthest;
}

TEST(SliceScan, TakesFewerPointsOfALargeScanWithinAFewHundredthsOfTheirDistance) {
  SliceRequest request = request_for();
  request.intake.most_points = 12'000;
  const Outcome outcome = slice(dense_text(), request);
  ASSERT_TRUE(outcome.report) << outcome.report.error().what;
  EXPECT_LE(outcome.report->points, 12'000U);
  EXPECT_GT(outcome.report->points, 5'000U);
  EXPECT_TRUE(outcome.report->flagged.empty());
  EXPECT_LT(farthest_off(outcome), 0.03 * outcome.report->kernel.spacing_mm);
  EXPECT_GT(farthest_off(outcome), 0);
}

TEST(SliceScan, SaysHowManyPointsItTookAndWhetherTheyShowLessThanAPixel) {
  SliceRequest request = request_for();
  request.intake.most_points = 12'000;
  const Outcome coarse = slice(dense_text(), request);
  ASSERT_TRUE(coarse.report) << coarse.report.error().what;
  EXPECT_THAT(coarse.report->warnings, testing::Contains(testing::HasSubstr("points of the file")));
  EXPECT_THAT(coarse.report->warnings, testing::Contains(testing::HasSubstr("a pixel is 0.1 mm wide")));
  request.machine.projection.pixel_pitch_mm = 1;
  const Outcome fine = slice(dense_text(), request);
  ASSERT_TRUE(fine.report) << fine.report.error().what;
  EXPECT_THAT(fine.report->warnings, testing::Contains(testing::HasSubstr("points of the file")));
  EXPECT_THAT(fine.report->warnings, testing::Not(testing::Contains(testing::HasSubstr("a pixel is"))));
  request.intake.most_points = 100'000;
  const Outcome whole = slice(dense_text(), request);
  ASSERT_TRUE(whole.report) << whole.report.error().what;
  EXPECT_TRUE(whole.report->warnings.empty());
}

TEST(SliceScan, OfManyPointsGivesTheSameBytesOnAnyNumberOfThreads) {
  SliceRequest one = request_for(1), four = request_for(4);
  one.intake.most_points = four.intake.most_points = 8'000;
  const Outcome alone = slice(dense_text(), one);
  EXPECT_FALSE(alone.text.empty());
  EXPECT_EQ(slice(dense_text(), four).text, alone.text);
}

TEST(SliceScan, LetsTheBytesOfTheFileGoWhileItReadsThem) {
  SliceRequest request = request_for();
  int times = 0;
  request.intake.let_go = [&] { ++times; };
  request.intake.most_points = 8'000;
  ASSERT_TRUE(slice(dense_text(), request).report);
  EXPECT_GT(times, 3);
}

}  // namespace
}  // namespace telefab::scan
