// SPDX-License-Identifier: GPL-3.0-or-later
#include <gtest/gtest.h>

#include <telefab/test/analytic_field.hpp>

#include "contour_way.hpp"

namespace telefab::scan::topology {
namespace {

/// Only these critical points are known.
struct Ascent {
  Ascent(test::Shape of, std::vector<CriticalPoint> points, const Vec3& start)
      : shape{std::move(of)},
        known{std::move(points)},
        index{*shape, known},
        cursor{shape->cursor()},
        way{follow_steepest(*shape, *cursor, index, start, true, {})} {}
  test::Shape shape;
  std::vector<CriticalPoint> known;
  CriticalIndex index;
  std::unique_ptr<FieldCursor> cursor;
  ContourWay way;
};

CriticalPoint top_at(const Vec3& place) {
  return {.position_mm = place, .kind = CriticalKind::Maximum, .normal_up = true};
}

TEST(ContourWay, GoesOnFromElsewhereOnTheContourWhereItsCurveIsLostOnATopNobodySaw) {
  Ascent up{test::ball_with_knobs(34, 1), {top_at({0, 0, 34})}, {0, 28.3, 0}};
  ASSERT_FALSE(up.way.end);
  const Vec3 lost = up.way.path_mm.back();
  ASSERT_NEAR(lost.y(), 8.84, 0.1) << "the knob's top";

  ASSERT_TRUE(go_on_elsewhere(*up.shape, *up.cursor, up.index, true, up.way, {}));
  EXPECT_EQ(up.way.end, std::size_t{0});
  EXPECT_NEAR(up.way.path_mm.back().z(), 34, 1e-9);
  ASSERT_EQ(up.way.losses_mm.size(), 1u);
  EXPECT_EQ(up.way.losses_mm[0], lost);
  EXPECT_TRUE(std::is_sorted(up.way.path_mm.begin(), up.way.path_mm.end(), [](const Vec3& a, const Vec3& b) {
    return a.z() <= b.z();
  })) << "no height comes twice";
}

TEST(ContourWay, HasAnEndWhereTheContourItselfEnds) {
  Ascent up{test::sphere(20, 1), {}, {20, 0, 0}};
  ASSERT_FALSE(up.way.end);
  ASSERT_NEAR(up.way.path_mm.back().z(), 20, 0.1);
  const std::size_t places = up.way.path_mm.size();
  EXPECT_FALSE(go_on_elsewhere(*up.shape, *up.cursor, up.index, true, up.way, {}));
  EXPECT_EQ(up.way.path_mm.size(), places);
  EXPECT_TRUE(up.way.losses_mm.empty());
}

TEST(ContourWay, DoesNotLeaveAnEndThatIsKnown) {
  Ascent up{test::sphere(20, 1), {top_at({0, 0, 20})}, {20, 0, 0}};
  ASSERT_TRUE(up.way.end);
  EXPECT_FALSE(go_on_elsewhere(*up.shape, *up.cursor, up.index, true, up.way, {}));
}

}  // namespace
}  // namespace telefab::scan::topology
