// SPDX-License-Identifier: GPL-3.0-or-later
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <tbb/global_control.h>
#include <tbb/task_arena.h>

#include <Eigen/Geometry>
#include <telefab/scan/placing/standing.hpp>

namespace telefab::scan {
namespace {

using testing::HasSubstr;

/// A body of boxes that overlap or touch, as points with outward normals.
PointCloud body_of(const std::vector<Box3>& boxes, double spacing) {
  PointCloud cloud;
  const auto put = [&](std::size_t self, const Vec3& p, const Vec3& n) {
    for (std::size_t other = 0; other < boxes.size(); ++other)
      if (other != self && boxes[other].contains(p + 0.01 * spacing * n)) return;
    cloud.points.push_back(p.cast<float>());
    cloud.normals.push_back(n.cast<float>());
  };
  for (std::size_t b = 0; b < boxes.size(); ++b)
    for (int axis = 0; axis < 3; ++axis) {
      const int u = (axis + 1) % 3, v = (axis + 2) % 3;
      const Vec3 size = boxes[b].size();
      const int nu = static_cast<int>(std::ceil(size[u] / spacing)),
                nv = static_cast<int>(std::ceil(size[v] / spacing));
      for (int i = 0; i < nu; ++i)
        for (int j = 0; j < nv; ++j)
          for (const bool top : {false, true}) {
            Vec3 p = boxes[b].min;
            p[u] += (i + 0.5) * size[u] / nu;
            p[v] += (j + 0.5) * size[v] / nv;
            if (top) p[axis] = boxes[b].max[axis];
            put(b, p, (top ? 1 : -1) * Vec3::Unit(axis));
          }
    }
  return cloud;
}

/// Stands on its legs.
PointCloud table() {
  std::vector<Box3> boxes{{{0, 0, 25}, {40, 30, 28}}};
  for (const double x : {0, 36})
    for (const double y : {0, 26}) boxes.push_back({{x, y, 0}, {x + 4, y + 4, 25}});
  return body_of(boxes, 0.7);
}

PointCloud mushroom() { return body_of({{{-4, -4, 0}, {4, 4, 20}}, {{-15, -15, 20}, {15, 15, 24}}}, 0.6); }

PointCloud turned(PointCloud cloud, const Turn& turn) {
  for (auto& p : cloud.points) p = (turn.matrix() * p.cast<double>()).cast<float>();
  for (auto& n : cloud.normals) n = (turn.matrix() * n.cast<double>()).cast<float>();
  return cloud;
}

StandingOptions options() {
  StandingOptions o;
  o.machine.name = "bench";
  o.machine.platform = {120, 80, 100};
  o.machine.projection.pixel_pitch_mm = 0.1;
  o.machine.layers.thickness_mm = 0.1;
  o.layer_mm = 0.1;
  // Few are enough to find what is obvious; axes and flat sides come on top.
  o.directions = 24;
  o.in_full = 8;
  o.corners = 200'000;
  return o;
}

std::vector<Standing> judged(const PointCloud& cloud, const StandingOptions& o) {
  auto found = judged_standings(cloud, o, {}, {});
  EXPECT_TRUE(found) << found.error().what;
  return found ? *found : std::vector<Standing>{};
}

Vec3 up_of(const Standing& s) { return s.turn.matrix().row(2); }

const Standing* as_in_file(const std::vector<Standing>& all) {
  for (const Standing& s : all)
    if (s.source == StandingSource::AsInFile) return &s;
  return nullptr;
}

TEST(Standing, TableIsLaidOnItsTop) {
  const auto all = judged(table(), options());
  ASSERT_FALSE(all.empty());
  EXPECT_GT(up_of(all[0]).dot(-Vec3::UnitZ()), 0.9999);
  EXPECT_EQ(all[0].figures.support_mm3, 0);
  EXPECT_FALSE(all[0].figures.is_lifted);
  // On its legs the whole top hangs free.
  const Standing* on_legs = as_in_file(all);
  ASSERT_NE(on_legs, nullptr);
  EXPECT_NEAR(on_legs->figures.overhang_mm2, 40 * 30 - 4 * 16, 0.15 * 1200);
  EXPECT_GT(on_legs->figures.support_mm3, 500);
}

TEST(Standing, MushroomIsLaidOnItsCap) {
  const auto all = judged(mushroom(), options());
  ASSERT_FALSE(all.empty());
  EXPECT_GT(up_of(all[0]).dot(-Vec3::UnitZ()), 0.9999);
  EXPECT_NEAR(all[0].figures.part_mm3, 64 * 20 + 900 * 4, 0.04 * 4880);
  EXPECT_NEAR(all[0].figures.size_mm.z(), 24, 0.01);
}

TEST(Standing, LowestIsTakenForHeight) {
  StandingOptions o = options();
  o.goal = StandFor::Height;
  const auto all = judged(body_of({{{0, 0, 0}, {10, 30, 20}}}, 0.6), o);
  ASSERT_FALSE(all.empty());
  EXPECT_NEAR(std::abs(up_of(all[0]).x()), 1, 1e-6);
  // Along the wide platform.
  EXPECT_NEAR(all[0].figures.size_mm.x(), 30, 0.1);
  EXPECT_NEAR(all[0].figures.size_mm.y(), 20, 0.1);
}

TEST(Standing, ChoiceDoesNotDependOnHowTheScanLay) {
  const PointCloud cloud = mushroom();
  for (const char* angles : {"33,-20,71", "100,5,-160", "-70,40,10"}) {
    const Turn turn = turn_from_rotate(angles).value();
    const auto all = judged(turned(cloud, turn), options());
    ASSERT_FALSE(all.empty());
    const Vec3 up = turn.matrix().transpose() * up_of(all[0]);
    EXPECT_GT(up.dot(-Vec3::UnitZ()), 0.9999) << angles;
    EXPECT_EQ(all[0].source, StandingSource::FlatSide) << angles;
    EXPECT_LT(all[0].figures.support_mm3, 1) << angles;
    // A quarter turn about the vertical is as good as none.
    EXPECT_NEAR(all[0].figures.size_mm.x(), 30, 0.2) << angles;
  }
}

TEST(Standing, CupKeepsLiquidUnlessItLiesOnItsSide) {
  // A square cup, its opening up.
  const PointCloud cup = body_of({{{0, 0, 0}, {24, 24, 3}},
                                  {{0, 0, 0}, {3, 24, 24}},
                                  {{21, 0, 0}, {24, 24, 24}},
                                  {{0, 0, 0}, {24, 3, 24}},
                                  {{0, 21, 0}, {24, 24, 24}}},
                                 0.6);
  StandingOptions o = options();
  o.directions = 1;
  o.in_full = 100;
  const auto all = judged(cup, o);
  const Standing* upright = as_in_file(all);
  ASSERT_NE(upright, nullptr);
  EXPECT_NEAR(upright->figures.trapped_mm3, 18 * 18 * 21, 0.08 * 18 * 18 * 21);
  for (const Standing& s : all) {
    if (std::abs(up_of(s).x()) > 0.9999 || std::abs(up_of(s).y()) > 0.9999) {
      EXPECT_EQ(s.figures.trapped_mm3, 0) << up_of(s).transpose();
    }
  }
}

TEST(Standing, CubeOnItsCornerGetsAnchorsThatSteadyIt) {
  const auto all = judged(body_of({{{0, 0, 0}, {20, 20, 20}}}, 0.7), options());
  int lifted = 0;
  for (const Standing& s : all) {
    if (!s.figures.is_lifted) continue;
    ++lifted;
    EXPECT_GE(s.figures.anchors, 3U) << up_of(s).transpose();
    EXPECT_GT(s.figures.stability, -0.1) << up_of(s).transpose();
  }
  EXPECT_GT(lifted, 0);
}

// It needs no supports that way, and would be the cheapest of all.
TEST(Standing, WhatWouldFallOffItsFootIsNotChosen) {
  std::vector<Box3> leaning;
  // In steps that bending bears: 0.15 mm a layer.
  for (int i = 0; i < 160; ++i) leaning.push_back({{0.15 * i, 0, 0.25 * i}, {0.15 * i + 10, 10, 0.25 * (i + 1)}});
  const auto all = judged(body_of(leaning, 0.6), options());
  const Standing* leans = as_in_file(all);
  ASSERT_NE(leans, nullptr);
  EXPECT_FALSE(leans->figures.is_lifted);
  EXPECT_LT(leans->figures.stability, -0.1);
  EXPECT_TRUE(all.front().figures.is_lifted || all.front().figures.stability >= 0);
  EXPECT_GT(leans->cost, all.front().cost + 1);
}

TEST(Standing, SameOnAnyNumberOfThreads) {
  const PointCloud cloud = turned(table(), turn_from_rotate("20,30,40").value());
  const auto on = [&](int threads) {
    const tbb::global_control allow{tbb::global_control::max_allowed_parallelism, 8};
    tbb::task_arena arena{threads};
    return arena.execute([&] { return judged(cloud, options()); });
  };
  const auto one = on(1), many = on(8);
  ASSERT_EQ(one.size(), many.size());
  for (std::size_t i = 0; i < one.size(); ++i) {
    EXPECT_EQ(one[i].turn, many[i].turn);
    EXPECT_EQ(one[i].figures, many[i].figures);
  }
}

TEST(Standing, TextOfItsTurnGivesTheSameTurn) {
  for (const Standing& s : judged(mushroom(), options())) {
    EXPECT_EQ(turn_from_rotate(rotate_text(s.turn)).value(), s.turn) << rotate_text(s.turn);
  }
}

TEST(Standing, SizeAskedForHoldsEachWay) {
  StandingOptions o = options();
  o.height_mm = 10;
  o.axis_scale = {1, 1, 1.1};
  for (const Standing& s : judged(mushroom(), o)) EXPECT_NEAR(s.figures.size_mm.z(), 11, 1e-6);
  o.height_mm.reset();
  o.fit = true;
  for (const Standing& s : judged(mushroom(), o)) {
    EXPECT_LT(s.figures.size_mm.x(), 120);
    EXPECT_LT(s.figures.size_mm.y(), 80);
    EXPECT_LT(s.figures.size_mm.z() + o.machine.supports.lift_off_mm, 100);
  }
}

TEST(Standing, PartThatFitsNoWayIsRefusedWithTheRoom) {
  StandingOptions o = options();
  o.scale = 6;
  const auto found = judged_standings(mushroom(), o, {}, {});
  ASSERT_FALSE(found);
  EXPECT_THAT(found.error().what, HasSubstr("120 x 80 mm platform, 100 mm travel"));
}

TEST(Standing, CanBeCancelled) {
  std::stop_source stop;
  stop.request_stop();
  EXPECT_EQ(judged_standings(mushroom(), options(), {}, stop.get_token()).error().code, ErrorCode::Cancelled);
}

TEST(Standing, OptionsOutOfRangeAreRefused) {
  StandingOptions o = options();
  o.layer_mm = 0;
  EXPECT_EQ(o.validate().error().code, ErrorCode::InvalidInput);
  o = options();
  o.directions = 0;
  EXPECT_EQ(o.validate().error().code, ErrorCode::InvalidInput);
  o = options();
  o.in_full = 0;
  EXPECT_EQ(o.validate().error().code, ErrorCode::InvalidInput);
  o = options();
  o.corners = 10;
  EXPECT_EQ(o.validate().error().code, ErrorCode::InvalidInput);
  o = options();
  o.scale = -1;
  EXPECT_EQ(o.validate().error().code, ErrorCode::InvalidInput);
  EXPECT_THAT(stand_for_from("speed").error().what, HasSubstr("supports, height, quality"));
}

TEST(Standing, BestFewDifferInDirection) {
  const auto all = judged(table(), options());
  const auto few = best_apart(all, 5, 20);
  EXPECT_EQ(few.front().turn, all.front().turn);
  for (std::size_t i = 0; i < few.size(); ++i)
    for (std::size_t j = 0; j < i; ++j) EXPECT_LT(up_of(few[i]).dot(up_of(few[j])), std::cos(20 * 3.14159265 / 180));
}

}  // namespace
}  // namespace telefab::scan
