// SPDX-License-Identifier: GPL-3.0-or-later
#include <gtest/gtest.h>

#include <cmath>
#include <telefab/scan/section/follow_arc.hpp>
#include <telefab/test/analytic_field.hpp>

namespace telefab::test {
namespace {

using scan::ArcEnd;
using scan::ArcPlace;
using scan::ArcStep;
using scan::follow_arc;
using scan::PlaneCursor;
using scan::Vec2;

constexpr double kTolerance_mm = 1e-6;

TEST(PlaneCursor, ProjectsOntoTheSectionWithoutLeavingThePlane) {
  const Shape ball = sphere(20, 1);
  const auto cursor = ball->cursor();
  PlaneCursor plane{*cursor, 12};
  const auto on = plane.project_in_plane({17, 0}, 3, kTolerance_mm);
  ASSERT_TRUE(on);
  EXPECT_NEAR(on->at.x_mm, 16, 1e-5);
  EXPECT_NEAR(on->normal().x_mm, 1, 1e-6);
  EXPECT_NEAR(on->tangent().y(), 1, 1e-6) << "solid lies on the left";
  EXPECT_FALSE(plane.project_in_plane({19, 0}, 1, kTolerance_mm)) << "farther than it may go";
  PlaneCursor top{*cursor, 20};
  EXPECT_FALSE(top.project_in_plane({0, 0}, 3, kTolerance_mm)) << "level there";
}

TEST(FirstOrderCrossing, LiesWhereTheTangentPlaneCutsThePlane) {
  const Vec3 normal{0.8, 0, 0.6}, place{8, 0, 6};
  const auto p = scan::first_order_crossing(place, normal, 6.4, 1, 0.3);
  ASSERT_TRUE(p);
  EXPECT_NEAR((Vec3{p->x(), p->y(), 6.4} - place).dot(normal), 0, 1e-12);
  EXPECT_NEAR(p->x(), 7.7, 1e-12);
  EXPECT_FALSE(scan::first_order_crossing(place, normal, 6.4, 0.2, 0.3)) << "farther than it may be";
  EXPECT_FALSE(scan::first_order_crossing(place, normal, 6.4, 1, 0.9)) << "too level to say anything";
}

/// Steps of a fixed length, as far as they are allowed.
struct PlainRules {
  static constexpr std::size_t kernel_every = 8;
  static constexpr double shortest_step_kernels = 1e-3;
  double first_step_mm = 0.5, longest_step_kernels = 1;
  PlaneCursor& plane;
  std::size_t most = 10'000, count = 1;

  [[nodiscard]] bool goes_on() const { return count < most; }
  [[nodiscard]] std::size_t places() const { return count; }
  [[nodiscard]] static double kernel_at(const Vec2&) { return 1; }
  [[nodiscard]] std::optional<ArcPlace> project(const Vec2& p, double, double most_move_mm) const {
    const auto on = plane.project_in_plane({p.x(), p.y()}, most_move_mm, kTolerance_mm);
    if (!on) return std::nullopt;
    return ArcPlace::of(*on);
  }
  [[nodiscard]] static ArcStep judge(const ArcPlace& here, const std::optional<ArcPlace>& next, const Vec2&, double,
                                     double) {
    if (!next) return {0.5, true};
    return {0, false, std::atan2(scan::cross(here.tangent, next->tangent), here.tangent.dot(next->tangent))};
  }
  [[nodiscard]] static double closing_width(double length) { return 0.2 * length; }
  void keep(const ArcPlace&) { ++count; }
  [[nodiscard]] double next_step(double, double, double) const { return first_step_mm; }
};

TEST(FollowArc, ComesOnceAroundAndStopsWhereItIsNotLetOn) {
  const Shape ball = sphere(20, 1);
  const auto cursor = ball->cursor();
  PlaneCursor plane{*cursor, 12};
  const auto start = plane.project_in_plane({16, 0}, 3, kTolerance_mm);
  ASSERT_TRUE(start);
  PlainRules rules{.plane = plane};
  const ArcEnd around = follow_arc(ArcPlace::of(*start), 1, rules);
  EXPECT_TRUE(around.closed);
  EXPECT_NEAR(static_cast<double>(rules.count), 2 * 3.14159 * 16 / 0.5, 2);
  PlainRules few{.plane = plane, .most = 20};
  EXPECT_FALSE(follow_arc(ArcPlace::of(*start), 1, few).closed);
  EXPECT_EQ(few.count, 20U);
}

TEST(Between, LiesOnTheArcOfBothTangents) {
  const auto on_circle = [](double angle) {
    return ArcPlace{{std::cos(angle), std::sin(angle)}, {-std::sin(angle), std::cos(angle)}, 0};
  };
  const ArcPlace a = on_circle(0.2), b = on_circle(0.7);
  EXPECT_EQ(scan::between(a, b, 0), a.point);
  EXPECT_EQ(scan::between(a, b, 1), b.point);
  for (const double share : {0.2, 0.5, 0.9}) EXPECT_NEAR(scan::between(a, b, share).norm(), 1, 2e-5) << share;
}

/// Steps of 1 mm are tried and those above 0.65 mm refused.
struct ShortRules : PlainRules {
  std::size_t projections = 0;
  double guesses_off_mm = 0;  ///< of places before a refused one, the most
  bool refused = false;
  [[nodiscard]] std::optional<ArcPlace> project(const scan::Vec2& guess, double, double most_move_mm) {
    ++projections;
    if (refused) guesses_off_mm = std::max(guesses_off_mm, std::abs(guess.norm() - 16));
    return PlainRules::project(guess, 1, most_move_mm);
  }
  [[nodiscard]] ArcStep judge(const ArcPlace& here, const std::optional<ArcPlace>& next, const scan::Vec2& chord,
                              double length, double step) {
    refused = length > 0.65;
    if (refused) return {0.4, false, 0, true};
    return PlainRules::judge(here, next, chord, length, step);
  }
};

TEST(FollowArc, GoesOnToTheRefusedPlaceWithoutLookingForItAgain) {
  const Shape ball = sphere(20, 1);
  const auto cursor = ball->cursor();
  PlaneCursor plane{*cursor, 12};
  const auto start = plane.project_in_plane({16, 0}, 3, kTolerance_mm);
  ASSERT_TRUE(start);
  ShortRules rules{{.first_step_mm = 1, .plane = plane}};
  EXPECT_TRUE(follow_arc(ArcPlace::of(*start), 1, rules).closed);
  // One refused, one before it, and then the refused one itself: two questions for two places.
  EXPECT_NEAR(static_cast<double>(rules.count), 2 * 3.14159 * 16 / 0.5, 3);
  EXPECT_LE(rules.projections, rules.count + 3);
  EXPECT_LT(rules.guesses_off_mm, 1e-4);
}

}  // namespace
}  // namespace telefab::test
