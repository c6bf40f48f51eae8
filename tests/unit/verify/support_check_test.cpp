// SPDX-License-Identifier: GPL-3.0-or-later
#include <gtest/gtest.h>

#include <telefab/fab/support/support_plan.hpp>
#include <telefab/fab/verify/print_files.hpp>
#include <telefab/fab/verify/support_check.hpp>

#include "stacks.hpp"

namespace telefab::fab {
namespace {

SupportReport checked(const stacks::Stack& s, const SupportPlan& plan) {
  PrintGeometry print;
  print.part = s.layers;
  print.elevation_layers = plan.elevation_layers();
  print.support = [&](LayerIndex k) { return plan.section(k); };
  for (const Anchor& a : plan.anchors()) print.anchors.emplace_back(a.place, a.layer);
  return check_supports(print, stacks::machine(), {}, {}).value();
}

SupportPlan planned(const stacks::Stack& s, SupportOptions options = {}) {
  return plan_supports(s.layers, s.header, stacks::machine(), options, {}, {}).value();
}

TEST(SupportCheck, PassesWhatThePlannerMakes) {
  for (const auto& s : {stacks::vault(), stacks::mushroom(), stacks::table(), stacks::ball(), stacks::hook(),
                        stacks::tilted_cylinder(), stacks::flag(), stacks::flag_in_a_shaft()}) {
    const auto report = checked(s, planned(s));
    EXPECT_TRUE(report.passes()) << to_json(report);
  }
}

TEST(WrittenSupports, CutTheSameSectionsFromTheFileAsThePlanner) {
  const auto s = stacks::mushroom();
  const auto plan = planned(s);
  const auto written = WrittenSupports::from_json(to_json(plan));
  ASSERT_TRUE(written);
  EXPECT_EQ(written->elevation_layers(), plan.elevation_layers());
  EXPECT_EQ(written->anchors().size(), plan.anchors().size());
  for (std::uint32_t k = 0; k < 60; k += 7) {
    const Region ours = Region::from_contours(written->section(LayerIndex{k}, 0.15)).value();
    const Region theirs = plan.section_region(LayerIndex{k});
    EXPECT_NEAR(ours.area_mm2(), theirs.area_mm2(), 0.06 * theirs.area_mm2()) << k;
    EXPECT_LT(subtract(theirs, offset(ours, Millimetres{0.02}, Millimetres{1e-3})).area_mm2(), 1e-6) << k;
  }
}

TEST(WrittenSupports, RefuseADamagedFile) {
  EXPECT_FALSE(WrittenSupports::from_json("{}"));
  EXPECT_FALSE(WrittenSupports::from_json("{\"lift_layers\":1"));
  EXPECT_FALSE(WrittenSupports::from_json(R"({"lift_layers":0,"anchors":[{}],"sticks":[],"plates":[]})"));
  EXPECT_FALSE(WrittenSupports::from_json(R"({"lift_layers":-3,"anchors":[],"sticks":[],"plates":[]})"));
  EXPECT_FALSE(WrittenSupports::from_json(R"({"lift_layers":4000000000,"anchors":[],"sticks":[],"plates":[]})"));
}

TEST(SupportCheck, FindsTheDropOfAHookThatNobodyHolds) {
  SupportOptions none;
  none.mode = SupportOptions::Mode::None;
  const auto report = checked(stacks::hook(), planned(stacks::hook(), none));
  ASSERT_EQ(report.count(Finding::Kind::Island), 1U);
  EXPECT_FALSE(report.passes());
  EXPECT_GT(report.count(Finding::Kind::OutOfReach), 0U);
}

/// A speck beside a block, for two layers: the second lies on the first but for a strip of `beyond` pixels.
stacks::Stack speck_that_ends(double beyond) {
  const double px = stacks::machine().projection.pixel_pitch_mm;
  return stacks::stack(3.0, [=](double z) {
    std::vector<std::vector<Point2>> rings{stacks::box(20, 20, 30, 30)};
    if (z > 1.2 && z < 1.35) rings.push_back(stacks::box(40, 20, 40 + 2 * px, 20 + 4 * px));
    if (z > 1.35 && z < 1.5)
      rings.push_back(stacks::box(40 + 1.6 * px, 20 + 2.5 * px, 40 + 2 * px + beyond * px, 20 + 4 * px));
    return rings;
  });
}

TEST(SupportCheck, FindsNoFreePinUnderASpeckThatEndsWithItsLayer) {
  for (const double beyond : {0.1, 0.3, 0.5, 0.7, 1.0, 2.0, 4.0}) {
    const auto s = speck_that_ends(beyond);
    const auto report = checked(s, planned(s));
    EXPECT_TRUE(report.passes()) << beyond << '\n' << to_json(report);
  }
}

TEST(SupportCheck, NoticesAnAnchorThatIsMissing) {
  const auto s = stacks::mushroom();
  const auto plan = planned(s);
  PrintGeometry print;
  print.part = s.layers;
  print.elevation_layers = plan.elevation_layers();
  print.support = [&](LayerIndex k) { return plan.section(k); };
  for (const Anchor& a : plan.anchors().subspan(1)) print.anchors.emplace_back(a.place, a.layer);
  EXPECT_GT(check_supports(print, stacks::machine(), {}, {})->count(Finding::Kind::OutOfReach), 0U);
}

TEST(SupportCheck, NoticesAPinThatHoldsNothing) {
  const auto s = stacks::table();
  PrintGeometry print;
  print.part = s.layers;
  print.support = [&](LayerIndex k) {
    std::vector<Contour> rings;
    if (k.count() < 20) rings.push_back(Contour::from_vertices(stacks::circle(10, 10, 1)).value());
    return rings;
  };
  EXPECT_EQ(check_supports(print, stacks::machine(), {}, {})->count(Finding::Kind::FreePin), 1U);
}

TEST(SupportCheck, LetsAPinEndInTheLayerWhereWhatItHoldsBeginsAndEnds) {
  // A speck of one layer, smaller than the pin under it.
  const auto s = stacks::stack(6, [](double z) {
    std::vector<std::vector<Point2>> rings{stacks::box(30, 30, 50, 50)};
    if (z > 3 && z < 3.15) rings.push_back(stacks::box(59.8, 59.8, 60.2, 60.2));
    return rings;
  });
  PrintGeometry print;
  print.part = s.layers;
  print.anchors.emplace_back(Point2{60, 60}, LayerIndex{20});
  const auto pin_up_to = [](std::uint32_t last) {
    return [last](LayerIndex k) {
      std::vector<Contour> rings;
      if (k.count() <= last) rings.push_back(Contour::from_vertices(stacks::circle(60, 60, 0.5)).value());
      return rings;
    };
  };
  print.support = pin_up_to(20);
  EXPECT_EQ(check_supports(print, stacks::machine(), {}, {})->count(Finding::Kind::FreePin), 0U);
  print.support = pin_up_to(21);
  EXPECT_EQ(check_supports(print, stacks::machine(), {}, {})->count(Finding::Kind::FreePin), 1U);
}

TEST(SupportCheck, CallsNoSkinAnIslandThatIsTooThinToCure) {
  const auto thin_plate = [](double wide) {
    return stacks::stack(6, [wide](double z) {
      std::vector<std::vector<Point2>> rings{stacks::box(30, 30, 50, 50)};
      if (z > 3) rings.push_back(stacks::box(60, 30, 60 + wide, 50));
      return rings;
    });
  };
  for (const auto& [wide, islands] : {std::pair{0.02, 0U}, {0.2, 1U}}) {
    const auto s = thin_plate(wide);
    PrintGeometry print;
    print.part = s.layers;
    EXPECT_EQ(check_supports(print, stacks::machine(), {}, {})->count(Finding::Kind::Island), islands) << wide;
  }
}

TEST(SupportCheck, LetsATipFadeOutOnTheLayerBelowHoweverSmall) {
  // A contact too small to hold what reaches beyond it; what lies on it as a whole needs nobody.
  const auto fading = [](double moved) {
    return stacks::stack(6, [moved](double z) {
      std::vector<std::vector<Point2>> rings{stacks::box(30, 30, 50, 50)};
      if (z > 2.9) rings = {stacks::box(40, 40, 40.25, 40.25)};
      if (z > 3.1) rings = {stacks::box(40 + moved, 40, 40.25 + moved, 40.25)};
      if (z > 3.3) rings.clear();
      return rings;
    });
  };
  for (const auto& [moved, findings] : {std::pair{0.0, 0U}, {0.1, 1U}}) {
    const auto s = fading(moved);
    PrintGeometry print;
    print.part = s.layers;
    EXPECT_EQ(check_supports(print, stacks::machine(), {}, {})->count(Finding::Kind::OutOfReach), findings) << moved;
  }
}

TEST(SupportCheck, NoticesASupportInAClosedHollow) {
  const auto s = stacks::stack(6, [](double z) {
    auto hole = stacks::box(44, 44, 56, 56);
    std::reverse(hole.begin(), hole.end());
    std::vector<std::vector<Point2>> rings{stacks::box(40, 40, 60, 60)};
    if (z > 1 && z < 5) rings.push_back(hole);
    return rings;
  });
  const auto plan = planned(s);
  const auto report = checked(s, plan);
  EXPECT_EQ(report.count(Finding::Kind::ResinTrap), 1U);
  EXPECT_EQ(report.count(Finding::Kind::TrappedSupport), plan.anchors().empty() ? 0U : 1U);
  EXPECT_FALSE(plan.anchors().empty());
}

}  // namespace
}  // namespace telefab::fab
