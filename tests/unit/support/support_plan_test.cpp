// SPDX-License-Identifier: GPL-3.0-or-later
#include <gtest/gtest.h>

#include <telefab/fab/support/support_plan.hpp>

#include "stacks.hpp"

namespace telefab::fab {
namespace {

SupportPlan planned(const stacks::Stack& s, SupportOptions options = {}) {
  return plan_supports(s.layers, s.header, stacks::machine(), options, {}, {}).value();
}

Region part(const stacks::Stack& s, std::size_t k) { return Region::from_contours(s.layers[k].contours).value(); }

TEST(SupportPlan, GivesAPlainVaultNoAnchors) {
  const auto plan = planned(stacks::vault());
  EXPECT_EQ(plan.anchors().size(), 0U);
  EXPECT_EQ(plan.elevation_layers(), 0U);
}

TEST(SupportPlan, AnchorsMushroomTableBallHookAndTiltedCylinder) {
  for (const auto& s :
       {stacks::mushroom(), stacks::table(), stacks::ball(), stacks::hook(), stacks::tilted_cylinder()}) {
    const auto plan = planned(s);
    EXPECT_GT(plan.anchors().size(), 0U);
  }
}

TEST(SupportPlan, LiftsABallAndLetsATableStand) {
  EXPECT_GE(planned(stacks::ball()).elevation_layers() * 0.15, 2.0 - 1e-9);
  EXPECT_EQ(planned(stacks::table()).elevation_layers(), 0U);
  SupportOptions never;
  never.stand = SupportOptions::Stand::Never;
  EXPECT_GT(planned(stacks::table(), never).elevation_layers(), 0U);
}

TEST(SupportPlan, StandsAPinOnThePartOnlyWhereNoneCanReachThePlatform) {
  const auto over_plate = planned(stacks::hook());
  EXPECT_GT(over_plate.figures().feet_on_part, 0U);
  EXPECT_EQ(planned(stacks::table()).figures().feet_on_part, 0U);
}

TEST(SupportPlan, KeepsShaftsClearOfThePart) {
  for (const auto& s : {stacks::mushroom(), stacks::table(), stacks::tilted_cylinder()}) {
    const auto plan = planned(s);
    for (const SupportElement& element : plan.structure().elements) {
      if (element.kind != SupportElementKind::Pin) continue;
      for (double z = element.bottom.z_mm; z < element.top.z_mm; z += 0.3) {
        const auto k = static_cast<std::int64_t>(z / 0.15) - plan.elevation_layers();
        if (k < 0) continue;
        const Region body = disc({element.bottom.x_mm, element.bottom.y_mm}, Millimetres{0.6}, Millimetres{0.01});
        EXPECT_LT(intersect(body, part(s, static_cast<std::size_t>(k))).area_mm2(), 1e-6);
      }
    }
  }
}

/// The part within a distance of a plan's supports, tips, arms and feet left out.
double near_shafts_mm3(const stacks::Stack& s, const SupportPlan& plan, double distance_mm) {
  double near = 0;
  for (const SupportElement& element : plan.structure().elements) {
    if (element.kind != SupportElementKind::Pin && element.kind != SupportElementKind::Brace) continue;
    for (std::size_t k = 0; k < s.layers.size(); ++k) {
      const double z = (static_cast<double>(k) + plan.elevation_layers() + 0.5) * 0.15;
      if (z < element.bottom.z_mm || z >= element.top.z_mm) continue;
      const double t = (z - element.bottom.z_mm) / (element.top.z_mm - element.bottom.z_mm);
      const auto mix = [t](double a, double b) { return a + t * (b - a); };
      const Region body =
          disc({mix(element.bottom.x_mm, element.top.x_mm), mix(element.bottom.y_mm, element.top.y_mm)},
               Millimetres{distance_mm + mix(element.bottom_radius_mm, element.top_radius_mm)}, Millimetres{0.01});
      near += intersect(body, part(s, k)).area_mm2() * 0.15;
    }
  }
  return near;
}

TEST(SupportPlan, StandsNoPinOnThePartWhereItWouldGrowIntoItsSide) {
  const auto plan = planned(stacks::hook_over_ribs());
  EXPECT_GT(plan.figures().feet_on_part, 0U);
  EXPECT_EQ(near_shafts_mm3(stacks::hook_over_ribs(), plan, 0), 0);
}

TEST(SupportPlan, PropsALonePinThatWouldStandFreeForTooLong) {
  const auto plan = planned(stacks::flag());
  ASSERT_GT(plan.anchors().size(), 0U);
  std::size_t pins = 0;
  for (const SupportElement& element : plan.structure().elements) {
    if (element.kind != SupportElementKind::Pin) continue;
    ++pins;
    EXPECT_GE(element.bottom_radius_mm, stacks::machine().supports.pin_radius_mm);
    EXPECT_LE(element.bottom_radius_mm, 1.6 * stacks::machine().supports.pin_radius_mm) << "no wider than a prop needs";
  }
  EXPECT_GT(pins, plan.anchors().size());
  EXPECT_GT(plan.figures().braces, 4U);
  EXPECT_EQ(near_shafts_mm3(stacks::flag(), plan, 0.35), 0);
}

TEST(SupportPlan, ThickensALonePinOnlyAsFarAsThePartLeavesRoom) {
  const auto plan = planned(stacks::flag_in_a_shaft());
  ASSERT_GT(plan.anchors().size(), 0U);
  EXPECT_EQ(near_shafts_mm3(stacks::flag_in_a_shaft(), plan, 0.35), 0);
}

TEST(SupportPlan, StandsThickPinsOnFeetNoNarrowerThanThey) {
  MachineProfile machine = stacks::machine();
  machine.supports.brace_pitch_mm = 60;  // no strut fits
  const auto s = stacks::flag();
  const auto plan = plan_supports(s.layers, s.header, machine, {}, {}, {}).value();
  double thickest = 0;
  for (const SupportElement& pin : plan.structure().elements) {
    if (pin.kind != SupportElementKind::Pin) continue;
    thickest = std::max(thickest, pin.bottom_radius_mm);
    for (const SupportElement& foot : plan.structure().elements)
      if (foot.kind == SupportElementKind::Foot && foot.top == pin.bottom) {
        EXPECT_DOUBLE_EQ(foot.top_radius_mm, pin.bottom_radius_mm);
        EXPECT_GT(foot.bottom_radius_mm, pin.bottom_radius_mm);
      }
  }
  EXPECT_GT(thickest, 1.7 * machine.supports.pin_radius_mm) << "wider than its height alone asks";
}

TEST(Structure, LosesNoLayerWhereOneStickEndsAndTheNextBegins) {
  // 0.285 is the middle of a layer of 0.01 but for rounding.
  Structure structure;
  structure.elements.push_back({SupportElementKind::Pin, {1, 1, 0}, {1, 1, 0.285}, 0.1, 0.1});
  structure.elements.push_back({SupportElementKind::Tip, {1, 1, 0.285}, {1, 1, 0.4}, 0.1, 0.05});
  const StructureSections sections{structure, 0.01, 60, Millimetres{1e-3}};
  for (std::uint32_t k = 0; k < 40; ++k) EXPECT_GT(sections.section(LayerIndex{k}).area_mm2(), 0.007) << k;
  EXPECT_TRUE(sections.section(LayerIndex{41}).empty());
}

TEST(SupportPlan, SharesAnchorsBetweenLayersOfASlope) {
  // Layer by layer the slope would want its own row; standing anchors count, so there are fewer than layers.
  const auto plan = planned(stacks::tilted_cylinder());
  EXPECT_LT(plan.anchors().size(), plan.figures().layers_with_regions);
}

TEST(SupportPlan, IsTheSameOnOneTwoAndEightThreads) {
  for (const auto& s : {stacks::ball(), stacks::hook(), stacks::tilted_cylinder()}) {
    SupportOptions options;
    options.threads = 1;
    const std::string one = to_json(planned(s, options));
    for (const int threads : {2, 8}) {
      options.threads = threads;
      EXPECT_EQ(to_json(planned(s, options)), one) << threads;
    }
  }
}

TEST(LayerStream, GivesTheSameSupportsForLayersThatComeOneByOne) {
  for (const auto& s : {stacks::ball(), stacks::hook(), stacks::tilted_cylinder(), stacks::table()}) {
    const std::string at_once = to_json(planned(s));
    LayerStream stream{stacks::machine()};
    for (const Layer& layer : s.layers) stream.add(layer);
    const auto part = stream.finish();
    ASSERT_TRUE(part);
    for (const int threads : {1, 2, 8}) {
      SupportOptions options;
      options.threads = threads;
      const auto plan = plan_supports(*part, s.header, stacks::machine(), options, {}, {});
      ASSERT_TRUE(plan);
      EXPECT_EQ(to_json(*plan), at_once) << threads;
    }
  }
}

TEST(LayerStream, SaysThatALayerIsMissing) {
  const auto s = stacks::ball();
  LayerStream stream{stacks::machine()};
  stream.add(s.layers[0]);
  stream.add(s.layers[2]);
  stream.add(s.layers[3]);
  const auto part = stream.finish();
  ASSERT_FALSE(part);
  EXPECT_EQ(part.error().code, ErrorCode::InvalidInput);
}

TEST(LayerStream, MayBeGivenUpHalfWay) {
  const auto s = stacks::ball();
  LayerStream stream{stacks::machine()};
  for (const Layer& layer : s.layers) stream.add(layer);
}

TEST(SupportPlanner, PlansAgainAsIfForTheFirstTime) {
  for (const auto& s : {stacks::ball(), stacks::hook(), stacks::table()}) {
    SupportOptions options;
    auto planner = SupportPlanner::make(s.layers, s.header, stacks::machine(), options, {}, {});
    ASSERT_TRUE(planner);
    const auto first = planner->plan({}, {}, {}, {});
    ASSERT_TRUE(first);
    EXPECT_EQ(to_json(*first), to_json(planned(s)));
    // All pins of the first plan were found to be too weak, and something floated.
    for (const Anchor& a : first->anchors()) options.bearing.push_back({a.place, a.layer, a.tip, 0.5});
    options.floating.push_back({first->anchors().front().place, first->anchors().front().layer});
    const auto again = planner->plan(options.floating, options.bearing, {}, {});
    const auto fresh = plan_supports(s.layers, s.header, stacks::machine(), options, {}, {});
    ASSERT_TRUE(again && fresh);
    EXPECT_EQ(to_json(*again), to_json(*fresh));
    EXPECT_NE(to_json(*again), to_json(*first)) << "so that the other case shows something";
    const auto back = planner->plan({}, {}, {}, {});
    ASSERT_TRUE(back);
    EXPECT_EQ(to_json(*back), to_json(*first));
  }
}

TEST(SupportPlan, SeesInWhichLayersAnotherHasTheSameSection) {
  const auto s = stacks::ball();
  SupportOptions options;
  const auto plan = planned(s);
  options.bearing.push_back({plan.anchors().front().place, plan.anchors().front().layer, TipClass::Heavy, 1});
  const auto wider = plan_supports(s.layers, s.header, stacks::machine(), options, {}, {});
  ASSERT_TRUE(wider);
  std::size_t same = 0;
  const auto layers = static_cast<std::uint32_t>(s.layers.size()) + plan.elevation_layers();
  for (std::uint32_t i = 0; i < layers; ++i) {
    EXPECT_TRUE(plan.has_same_section(plan, LayerIndex{i}));
    const bool is_same = plan.has_same_section(*wider, LayerIndex{i});
    if (is_same) {
      EXPECT_EQ(plan.section(LayerIndex{i}), wider->section(LayerIndex{i})) << i;
    }
    same += is_same;
  }
  EXPECT_GT(same, 0U);
  EXPECT_LT(same, layers);
}

TEST(SupportPlan, RefusesRegionsOfAnotherMachineOrOfFewerLayers) {
  const auto s = stacks::ball();
  MachineProfile other = stacks::machine();
  other.supports.self_support_mm = 2;
  const auto part = analyse_part(s.layers, other, {});
  ASSERT_TRUE(part);
  EXPECT_EQ(plan_supports(*part, s.header, stacks::machine(), {}, {}, {}).error().code, ErrorCode::InvalidInput);
  const auto fewer = analyse_part(std::span{s.layers}.first(5), stacks::machine(), {});
  ASSERT_TRUE(fewer);
  EXPECT_EQ(plan_supports(*fewer, s.header, stacks::machine(), {}, {}, {}).error().code, ErrorCode::InvalidInput);
}

TEST(SupportPlan, SteadiesALiftedBallOnThreePinsOrMore) {
  const auto plan = planned(stacks::ball());
  EXPECT_GE(plan.anchors().size(), 3U);
  EXPECT_GE(plan.figures().stability_mm, 0);
}

TEST(SupportPlan, KeepsALeaningPartOverItsPinsUntilTheLastLayer) {
  // A rod that leans by half its height: what would hold its first layer alone is left behind by its weight.
  const auto rod = stacks::stack(
      18, [](double z) { return std::vector<std::vector<Point2>>{stacks::circle(40 + 0.5 * z, 50, 2.5)}; });
  SupportOptions never;
  never.stand = SupportOptions::Stand::Never;
  const auto plan = planned(rod, never);
  EXPECT_GE(plan.figures().stability_mm, 0);
}

TEST(SupportPlan, SaysWhereAStandingPartLeavesItsFoot) {
  const auto crane = stacks::stack(20, [](double z) {
    return std::vector<std::vector<Point2>>{z < 16 ? stacks::box(40, 40, 46, 46) : stacks::box(40, 40, 90, 46)};
  });
  SupportOptions options;
  options.hand.forbidden.push_back({{65, 43}, 40, 0, 99});  // nothing may hold the arm
  const auto plan = planned(crane, options);
  EXPECT_LT(plan.figures().stability_mm, 0);
  EXPECT_GT(plan.figures().least_stable.count(), 100U);
}

TEST(SupportPlan, BeginsNoFootInTheAirBelowAThinShelf) {
  // Two shelves, the lower one of a single layer: what stands on it must not come out below.
  const auto shelves = stacks::stack(12, [](double z) {
    std::vector<std::vector<Point2>> rings{stacks::box(20, 40, 30, 60)};
    if (z > 5.95 && z < 6.08) rings = {stacks::box(20, 40, 60, 60)};
    if (z > 10) rings = {stacks::box(20, 40, 60, 60)};
    return rings;
  });
  const auto plan = planned(shelves);
  ASSERT_GT(plan.figures().feet_on_part, 0U);
  for (const SupportElement& element : plan.structure().elements) {
    if (element.bottom.z_mm < 1 ||
        (element.kind != SupportElementKind::Foot && element.kind != SupportElementKind::ThinPin))
      continue;
    const auto k = static_cast<std::size_t>(std::lround(element.bottom.z_mm / 0.15)) - plan.elevation_layers();
    EXPECT_TRUE(part(shelves, k).contains({element.bottom.x_mm, element.bottom.y_mm})) << element.bottom.z_mm;
  }
}

TEST(SupportPlan, MakesNothingWhenToldSo) {
  SupportOptions none;
  none.mode = SupportOptions::Mode::None;
  const auto plan = planned(stacks::ball(), none);
  EXPECT_EQ(plan.anchors().size(), 0U);
  EXPECT_EQ(plan.elevation_layers(), 0U);
  EXPECT_TRUE(plan.section(LayerIndex{0}).empty());
}

TEST(SupportPlan, ObeysTheHandList) {
  const auto list = hand_list_from_json(
      R"({"extra":[{"x_mm":50,"y_mm":50,"z_mm":0}],
          "forbidden":[{"x_mm":40,"y_mm":50,"radius_mm":4,"from_z_mm":0,"to_z_mm":99}]})");
  ASSERT_TRUE(list);
  SupportOptions options;
  options.hand = *list;
  const auto plan = planned(stacks::mushroom(), options);
  EXPECT_TRUE(std::any_of(plan.anchors().begin(), plan.anchors().end(), [](const Anchor& a) { return a.by_hand; }));
  for (const Anchor& a : plan.anchors()) EXPECT_GE(std::hypot(a.place.x_mm - 40, a.place.y_mm - 50), 3.9);
  EXPECT_GT(plan.figures().waived_mm2, 10);
}

TEST(SupportPlan, LeavesOutAnAnchorRemovedByHandAndMovesNoOther) {
  SupportOptions cover;
  cover.mode = SupportOptions::Mode::Cover;
  const auto before = planned(stacks::mushroom(), cover);
  ASSERT_GT(before.anchors().size(), 2U);
  const Anchor unwanted = before.anchors()[1];
  cover.hand.removed.push_back({unwanted.place, unwanted.layer});
  const auto after = planned(stacks::mushroom(), cover);
  EXPECT_EQ(after.figures().removed, 1U);
  ASSERT_EQ(after.anchors().size(), before.anchors().size() - 1);
  for (const Anchor& a : after.anchors()) {
    EXPECT_NE(a.place, unwanted.place);
    EXPECT_TRUE(std::any_of(before.anchors().begin(), before.anchors().end(),
                            [&](const Anchor& b) { return b.place == a.place && b.layer == a.layer; }))
        << a.place.x_mm << ' ' << a.place.y_mm;
  }
}

TEST(SupportPlan, PutsNoAnchorForThePullWhereOneWasRemovedByHand) {
  SupportOptions options;
  const auto before = planned(stacks::mushroom(), options);
  for (const Anchor& a : before.anchors()) options.hand.removed.push_back({a.place, a.layer});
  const auto after = planned(stacks::mushroom(), options);
  for (const Anchor& a : after.anchors())
    for (const Anchor& b : before.anchors())
      EXPECT_FALSE(a.layer == b.layer && a.place == b.place) << a.place.x_mm << ' ' << a.place.y_mm;
}

TEST(SupportPlan, HoldsAPlaceByHandAlsoWhereItsOwnAnchorWasRemoved) {
  const auto before = planned(stacks::mushroom());
  const Anchor moved = before.anchors().front();
  SupportOptions options;
  options.hand.removed.push_back({moved.place, moved.layer});
  options.hand.extra.push_back({{moved.place.x_mm + 0.1, moved.place.y_mm}, moved.layer.count() * 0.15});
  const auto after = planned(stacks::mushroom(), options);
  EXPECT_TRUE(std::any_of(after.anchors().begin(), after.anchors().end(), [&](const Anchor& a) {
    return a.by_hand && a.layer == moved.layer && a.place.x_mm == moved.place.x_mm + 0.1;
  }));
}

TEST(HandList, ComesBackFromItsText) {
  HandList list;
  list.extra.push_back({{1.0 / 3, -2}, 0.1});
  list.forbidden.push_back({{4, 5}, 0.7, 0, 9.1});
  list.removed.push_back({{1e-7, 2}, LayerIndex{12}});
  const auto read = hand_list_from_json(to_json(list));
  ASSERT_TRUE(read) << read.error().what;
  EXPECT_EQ(to_json(*read), to_json(list));
  ASSERT_EQ(read->extra.size(), 1U);
  EXPECT_EQ(read->extra[0].place, list.extra[0].place);
  ASSERT_EQ(read->removed.size(), 1U);
  EXPECT_EQ(read->removed[0].layer, list.removed[0].layer);
  EXPECT_EQ(to_json(HandList{}), R"({"extra":[],"forbidden":[],"removed":[]})");
}

TEST(HandList, RefusesARemovedAnchorWithoutALayer) {
  for (const char* layer : {"-1", "0.5", "1e9", "\"3\"", "null"})
    EXPECT_FALSE(hand_list_from_json(std::string{R"({"removed":[{"x_mm":1,"y_mm":2,"part_layer":)"} + layer + "}]}"))
        << layer;
  EXPECT_FALSE(hand_list_from_json(R"({"removed":[{"x_mm":1,"y_mm":2}]})"));
  EXPECT_TRUE(hand_list_from_json(R"({"removed":[{"x_mm":1,"y_mm":2,"part_layer":3}]})"));
}

TEST(HandList, RefusesUnknownKeysMissingNumbersAndNonsense) {
  EXPECT_FALSE(hand_list_from_json("[]"));
  EXPECT_FALSE(hand_list_from_json("{"));
  EXPECT_FALSE(hand_list_from_json(R"({"extras":[]})"));
  EXPECT_FALSE(hand_list_from_json(R"({"extra":[{"x_mm":1,"y_mm":2}]})"));
  EXPECT_FALSE(hand_list_from_json(R"({"extra":[{"x_mm":1,"y_mm":2,"z_mm":1e300}]})"));
  EXPECT_TRUE(hand_list_from_json("{}"));
}

TEST(SupportPlan, RefusesLayersOutOfOrder) {
  auto s = stacks::table();
  std::swap(s.layers[3], s.layers[4]);
  const auto plan = plan_supports(s.layers, s.header, stacks::machine(), {}, {}, {});
  ASSERT_FALSE(plan);
  EXPECT_EQ(plan.error().code, ErrorCode::InvalidInput);
}

TEST(SupportPlan, StopsWhenAsked) {
  std::stop_source source;
  source.request_stop();
  const auto s = stacks::ball();
  const auto plan = plan_supports(s.layers, s.header, stacks::machine(), {}, {}, source.get_token());
  ASSERT_FALSE(plan);
  EXPECT_EQ(plan.error().code, ErrorCode::Cancelled);
}

}  // namespace
}  // namespace telefab::fab
