// SPDX-License-Identifier: GPL-3.0-or-later
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <telefab/fab/support/support_plan.hpp>

#include "stacks.hpp"

// How tips and pins bear the pull of the film on the layer just exposed.
namespace telefab::fab {
namespace {

SupportPlan planned(const stacks::Stack& s, const MachineProfile& machine, const SupportOptions& options = {}) {
  return plan_supports(s.layers, s.header, machine, options, {}, {}).value();
}
SupportOptions covering() {
  SupportOptions options;
  options.mode = SupportOptions::Mode::Cover;
  return options;
}
SupportOptions lifted() {
  SupportOptions options;
  options.stand = SupportOptions::Stand::Never;
  return options;
}

double necks_mm2(const SupportPlan& plan) {
  double area = 0;
  for (const SupportElement& e : plan.structure().elements)
    if (e.kind == SupportElementKind::Tip) area += std::numbers::pi * e.bottom_radius_mm * e.bottom_radius_mm;
  return area;
}

std::size_t count(const SupportPlan& plan, TipClass tip) {
  const auto anchors = plan.anchors();
  return static_cast<std::size_t>(
      std::count_if(anchors.begin(), anchors.end(), [&](const Anchor& a) { return a.tip == tip; }));
}

/// A flat block, lifted: its largest layer is its first.
stacks::Stack block() {
  return stacks::stack(6, [](double) { return std::vector<std::vector<Point2>>{stacks::box(30, 30, 60, 50)}; });
}

TEST(Pull, GivesTipsTheAreaThatTheLargestLayerAsksForAndNotManyTimesAsMuch) {
  const MachineProfile machine = stacks::machine();
  const auto plan = planned(block(), machine, lifted());
  const double least_mm2 = 30 * 20 / machine.carried_demand();
  EXPECT_GE(necks_mm2(plan), least_mm2);
  EXPECT_LE(necks_mm2(plan), 2.5 * least_mm2);
  EXPECT_GT(plan.figures().bearing_demand, 0);
  EXPECT_LE(plan.figures().bearing_demand, machine.carried_demand());
}

TEST(Pull, AsksForNoMoreThanCoveringWhereNothingPulls) {
  MachineProfile above = stacks::machine();
  above.motion.pull_kpa = 0.1;  // printed from above
  const auto cover = planned(block(), above, [] {
    SupportOptions options = covering();
    options.stand = SupportOptions::Stand::Never;
    return options;
  }());
  const auto both = planned(block(), above, lifted());
  EXPECT_EQ(both.anchors().size(), cover.anchors().size());
  EXPECT_EQ(count(both, TipClass::Light), both.anchors().size());
  EXPECT_EQ(both.figures().bearing, 0U);
}

TEST(Pull, GrowsTheTipsWithThePull) {
  MachineProfile gentle = stacks::machine(), hard = gentle;
  gentle.motion.pull_kpa = 10;
  hard.motion.pull_kpa = 50;
  EXPECT_GT(necks_mm2(planned(block(), hard, lifted())), 2.5 * necks_mm2(planned(block(), gentle, lifted())));
}

TEST(Pull, LeavesWhatStandsOnThePlatformToThePlatform) {
  const auto plan = planned(stacks::mushroom(), stacks::machine());
  const auto cover = planned(stacks::mushroom(), stacks::machine(), covering());
  EXPECT_EQ(plan.elevation_layers(), 0U);
  EXPECT_EQ(plan.anchors().size(), cover.anchors().size());
}

TEST(Pull, PutsTipsOnBothSidesOfWhatIsPulledOffTheMiddle) {
  // A foot at one end of a beam: by the pull on the beam's middle the foot's pins would be torn off one by one.
  const auto s = stacks::stack(9, [](double z) {
    return std::vector<std::vector<Point2>>{z < 3 ? stacks::box(20, 40, 28, 50) : stacks::box(20, 40, 60, 50)};
  });
  const auto plan = planned(s, stacks::machine(), lifted());
  double stiffness = 0, x = 0;
  for (const Anchor& a : plan.anchors()) {
    const double weight = static_cast<double>(a.tip) / (a.layer.count() + 40.0);
    stiffness += weight, x += weight * a.place.x_mm;
  }
  EXPECT_NEAR(x / stiffness, 40, 6);
  EXPECT_LE(plan.figures().bearing_demand, stacks::machine().carried_demand());
}

TEST(Pull, BearsItAllWhateverTipsWereMadeNarrowerAgain) {
  // Beams on a foot at one end: the first tips stand where others do better later.
  for (double length = 12; length <= 44; length += 4) {
    const auto s = stacks::stack(6, [&](double z) {
      return std::vector<std::vector<Point2>>{stacks::box(20, 40, z < 2 ? 26 : 20 + length, 47)};
    });
    const auto plan = planned(s, stacks::machine(), lifted());
    EXPECT_LE(plan.figures().bearing_demand, 0.85 * stacks::machine().carried_demand() * (1 + 1e-6)) << length << " mm";
  }
}

/// A tray of 30 x 30 mm whose hollow opens upwards, away from the platform; with a slot through one wall or not.
stacks::Stack tray(bool has_slot) {
  return stacks::stack(12, [&](double z) {
    std::vector<std::vector<Point2>> rings{stacks::box(30, 30, 60, 60)};
    if (z < 2) return rings;
    if (has_slot)
      rings = {{{30, 30},
                {60, 30},
                {60, 60},
                {30, 60},
                {30, 48},
                {32, 48},
                {32, 58},
                {58, 58},
                {58, 32},
                {32, 32},
                {32, 44},
                {30, 44}}};
    else
      rings.push_back({{32, 32}, {32, 58}, {58, 58}, {58, 32}});
    return rings;
  });
}

TEST(Pull, HoldsATrayAgainstTheVacuumUnderIt) {
  const double open = necks_mm2(planned(tray(true), stacks::machine(), lifted()));
  const double closed = necks_mm2(planned(tray(false), stacks::machine(), lifted()));
  // 26 x 26 mm at 2.5 times the pull beside the bottom's 30 x 30 at once.
  EXPECT_GT(closed, 1.4 * open);
}

TEST(Pull, GrowsWithTheSpeedOfTheLiftWhereTheProfileSaysSo) {
  MachineProfile slow = stacks::machine();
  slow.motion.pull_speed_mm_per_s = 1;
  slow.motion.pull_speed_power = 1;
  MachineProfile fast = slow;
  slow.motion.lift_speed_mm_per_s = 1;
  fast.motion.lift_speed_mm_per_s = 2;
  EXPECT_GT(necks_mm2(planned(block(), fast, lifted())), 1.5 * necks_mm2(planned(block(), slow, lifted())));
}

TEST(Pull, GrowsWithSizeWhereTheProfileSaysSo) {
  MachineProfile grows = stacks::machine();
  grows.motion.pull_size_mm = 6;  // as much as the block's area over its perimeter
  EXPECT_GT(necks_mm2(planned(block(), grows, lifted())),
            1.5 * necks_mm2(planned(block(), stacks::machine(), lifted())));
}

/// Load under which each pin's free pieces buckle over what its tip is pulled with, the least of all.
double least_margin(const SupportPlan& plan, const MachineProfile& machine) {
  const auto& elements = plan.structure().elements;
  double least = std::numeric_limits<double>::infinity();
  for (const SupportElement& pin : elements) {
    if (pin.kind != SupportElementKind::Pin) continue;
    std::vector<double> held{pin.bottom.z_mm, pin.top.z_mm};
    double neck_mm = 0;
    for (const SupportElement& e : elements) {
      const auto at_pin = [&](const Point3& p) {
        return std::hypot(p.x_mm - pin.top.x_mm, p.y_mm - pin.top.y_mm) < 1e-9;
      };
      if (e.kind == SupportElementKind::Brace && at_pin(e.bottom)) held.push_back(e.bottom.z_mm);
      if (e.kind == SupportElementKind::Brace && at_pin(e.top)) held.push_back(e.top.z_mm);
      if (e.kind == SupportElementKind::Arm && at_pin(e.bottom)) neck_mm = e.top_radius_mm;
    }
    if (neck_mm == 0) continue;  // a companion
    std::sort(held.begin(), held.end());
    const double pi = std::numbers::pi;
    const auto anchors = plan.anchors();
    const auto anchor = std::find_if(anchors.begin(), anchors.end(), [&](const Anchor& a) {
      return std::hypot(a.foot.x_mm - pin.top.x_mm, a.foot.y_mm - pin.top.y_mm) < 1e-9;
    });
    if (anchor == anchors.end() || anchor->demand == 0) return 0;
    const double load_n = pi * neck_mm * neck_mm * anchor->demand * machine.pull_of_film_kpa() / 1000;
    for (std::size_t i = 1; i < held.size(); ++i) {
      const auto radius_at = [&](double z) {
        return std::lerp(pin.bottom_radius_mm, pin.top_radius_mm,
                         (z - pin.bottom.z_mm) / (pin.top.z_mm - pin.bottom.z_mm));
      };
      // A cone buckles as a shaft of its ends' geometric mean.
      const double free_mm = held[i] - held[i - 1], r2 = radius_at(held[i]) * radius_at(held[i - 1]);
      const double euler_n = pi * pi * pi * machine.modulus_of_green_mpa() * r2 * r2 / (4 * free_mm * free_mm);
      least = std::min(least, euler_n / load_n);
    }
  }
  return least;
}

TEST(Pull, LetsNoPinStandFreeForSoLongThatItBuckles) {
  MachineProfile machine = stacks::machine();
  machine.supports.lift_off_mm = 40;
  for (const double modulus_mpa : {40.0, 160.0, 1600.0}) {
    machine.resin.green_modulus_mpa = modulus_mpa;
    const auto plan = planned(block(), machine, lifted());
    EXPECT_EQ(plan.figures().may_buckle, 0U) << modulus_mpa;
    EXPECT_GE(least_margin(plan, machine), machine.supports.safety * (1 - 1e-6)) << modulus_mpa;
  }
}

TEST(Pull, SaysWhichPinsMayBuckleWhereNothingHelps) {
  MachineProfile machine = stacks::machine();
  machine.supports.lift_off_mm = 40;
  machine.resin.green_modulus_mpa = 0.01;
  EXPECT_GT(planned(block(), machine, lifted()).figures().may_buckle, 0U);
}

TEST(Pull, KeepsPlacesFreeThatAreForbiddenByHand) {
  SupportOptions options = lifted();
  options.hand.forbidden.push_back({{45, 40}, 5, 0, 100});
  const auto plan = planned(block(), stacks::machine(), options);
  for (const Anchor& a : plan.anchors()) EXPECT_GT(std::hypot(a.place.x_mm - 45, a.place.y_mm - 40), 5 - 1e-9);
  EXPECT_LE(plan.figures().bearing_demand, stacks::machine().carried_demand());
}

TEST(Pull, StandsItsPinsClearOfEachOther) {
  const auto plan = planned(block(), stacks::machine(), lifted());
  const auto anchors = plan.anchors();
  std::size_t near = 0;
  for (std::size_t i = 0; i < anchors.size(); ++i)
    for (std::size_t j = 0; j < i; ++j)
      near += std::hypot(anchors[i].place.x_mm - anchors[j].place.x_mm, anchors[i].place.y_mm - anchors[j].place.y_mm) <
              2 * stacks::machine().supports.pin_radius_mm;
  EXPECT_EQ(near, 0U);
}

TEST(Pull, IsBorneByTheSamePinsOnAnyNumberOfThreads) {
  SupportOptions one = lifted(), many = lifted();
  one.threads = 1;
  many.threads = 8;
  EXPECT_EQ(to_json(planned(stacks::ball(), stacks::machine(), one)),
            to_json(planned(stacks::ball(), stacks::machine(), many)));
}

TEST(Pull, KeepsTheAnchorsOfAnEarlierPlanAndHelpsTheWeakOnes) {
  const auto before = planned(block(), stacks::machine(), lifted());
  SupportOptions again = lifted();
  for (const Anchor& a : before.anchors()) again.bearing.push_back({a.place, a.layer, a.tip, 1});
  const auto same = planned(block(), stacks::machine(), again);
  EXPECT_EQ(same.anchors().size(), before.anchors().size());
  again.bearing.front().strength = 0.3;
  const auto helped = planned(block(), stacks::machine(), again);
  EXPECT_GE(necks_mm2(helped), necks_mm2(before));
  for (const Anchor& a : before.anchors())
    EXPECT_TRUE(std::any_of(helped.anchors().begin(), helped.anchors().end(), [&](const Anchor& b) {
      return b.place == a.place && b.layer == a.layer && b.tip >= a.tip;
    }));
}

TEST(Pull, RefusesAnAnchorOfAnEarlierPlanWithoutStrength) {
  SupportOptions options;
  options.bearing.push_back({{1, 1}, LayerIndex{3}, TipClass::Light, 0});
  EXPECT_EQ(options.validate().error().code, ErrorCode::InvalidInput);
}

TEST(Pull, SinksATipByItsRadiusButNeverOutOfAThinPart) {
  const auto tops = [](double height_mm) {
    const auto s =
        stacks::stack(height_mm, [](double) { return std::vector<std::vector<Point2>>{stacks::box(30, 30, 50, 50)}; });
    const auto plan = planned(s, stacks::machine(), lifted());
    double top = 0;
    for (const SupportElement& e : plan.structure().elements)
      if (e.kind == SupportElementKind::Tip) top = std::max(top, e.top.z_mm - plan.elevation_layers() * 0.15);
    return top;
  };
  EXPECT_GT(tops(3), 0.29) << "a heavy tip goes 0.4 mm deep, in whole layers";
  EXPECT_LE(tops(0.3), 0.3 + 1e-9);
}

TEST(Pull, TakesTipsThatAreWiderThanTheirPins) {
  MachineProfile machine = stacks::machine();
  machine.supports.tip_radius_mm = 0.6;
  EXPECT_GT(planned(block(), machine, lifted()).anchors().size(), 2U);
  EXPECT_GT(plan_supports(stacks::ball().layers, stacks::ball().header, machine, covering(), {}, {})->anchors().size(),
            0U);
}

/// Base plates by kind.
SupportPlan on(RaftKind raft) {
  MachineProfile machine = stacks::machine();
  machine.supports.raft = raft;
  return planned(block(), machine, lifted());
}

TEST(Raft, CoversTheFeetByOnePlateOrByBarsOrByDiscsOrNotAtAll) {
  const double none = on(RaftKind::None).section_region(LayerIndex{2}).area_mm2();
  const double bars = on(RaftKind::Plates).section_region(LayerIndex{2}).area_mm2();
  const double discs = on(RaftKind::Skate).section_region(LayerIndex{2}).area_mm2();
  const auto plate = on(RaftKind::Plate).section_region(LayerIndex{2});
  EXPECT_LT(none, bars);
  EXPECT_LT(none, discs);
  EXPECT_GT(plate.area_mm2(), 30 * 20 * 0.8);
  EXPECT_EQ(plate.pieces().size(), 1U);
  EXPECT_EQ(plate.rings().size(), 1U) << "no holes in which resin would be caught";
}

TEST(Raft, RecedesAtThePlatformSoThatAScraperGetsUnderIt) {
  const auto plan = on(RaftKind::Plate);
  EXPECT_LT(plan.section_region(LayerIndex{0}).area_mm2(), plan.section_region(LayerIndex{1}).area_mm2());
  MachineProfile upright = stacks::machine();
  upright.supports.raft = RaftKind::Plate;
  upright.supports.raft_lip_degrees = 0;
  const auto plain = planned(block(), upright, lifted());
  EXPECT_DOUBLE_EQ(plain.section_region(LayerIndex{0}).area_mm2(), plain.section_region(LayerIndex{1}).area_mm2());
}

TEST(Raft, LiesUnderEachGroupOfALiftedPartWithoutHolesThatWouldHoldResin) {
  const auto lifted_block = on(RaftKind::Auto);
  EXPECT_EQ(lifted_block.structure().plates.size(), 1U);
  EXPECT_EQ(lifted_block.section_region(LayerIndex{2}).rings().size(), 1U);
}

TEST(Raft, IsOfBarsBesideAPartThatStands) {
  const auto plan = planned(stacks::mushroom(), stacks::machine());
  EXPECT_FALSE(plan.structure().plates.empty());
  for (const Plate& plate : plan.structure().plates)
    EXPECT_LE(plate.corners.size(), 2U) << "a plate would grow to the part";
}

TEST(Raft, BecomesOnePlateWhereTheGroupsCoverTooLittleOfTheLargestLayer) {
  // Few pins, far apart, below a roof.
  MachineProfile machine = stacks::machine();
  machine.motion.pull_kpa = 0.1;
  machine.supports.anchor_distance_mm = 8;
  const auto plan = planned(block(), machine, lifted());
  ASSERT_EQ(plan.structure().plates.size(), 1U);
  EXPECT_GT(plan.structure().plates.front().corners.size(), 2U);
}

TEST(Ground, LeavesPinsAwayThatWouldStandOnThePartAndCountsThem) {
  MachineProfile machine = stacks::machine();
  ASSERT_GT(planned(stacks::hook(), machine).figures().feet_on_part, 0U);
  machine.supports.ground = PinGround::Platform;
  const auto plan = planned(stacks::hook(), machine);
  EXPECT_EQ(plan.figures().feet_on_part, 0U);
  EXPECT_GT(plan.figures().unreached, 0U);
}

TEST(Density, GivesMoreAnchorsThanWouldDo) {
  MachineProfile machine = stacks::machine();
  const std::size_t plain = planned(block(), machine, lifted()).anchors().size();
  machine.supports.density = 2;
  EXPECT_GT(planned(block(), machine, lifted()).anchors().size(), plain + plain / 2);
}

}  // namespace
}  // namespace telefab::fab
