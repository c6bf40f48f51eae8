// SPDX-License-Identifier: GPL-3.0-or-later
#include <gtest/gtest.h>

#include <cmath>
#include <telefab/base/digest.hpp>
#include <telefab/fab/mask/blend.hpp>
#include <telefab/test/mask_shapes.hpp>

// Masks of one layer, judged by the cure module: another kernel, another author of the light's sum.
namespace telefab::fab {
namespace {

using test::judge_machine;

MaskLight light_of(const MachineProfile& machine, double tau) {
  MaskLight light = mask_light(machine).value();
  light.white = std::exp(light.layer_mm / (2 * light.penetration_mm)) / tau;
  return light;
}

Mask blended(const MachineProfile& machine, double tau, std::span<const Contour> rings, BlendOptions options = {}) {
  return MaskBlender::make(mask_frame(machine), light_of(machine, tau), options).value().blend({.part = rings}).mask;
}

struct Setting {
  double spread_px, tau, mean_px, smooth_px, corner_px;
};
class BlendedShapes : public testing::TestWithParam<Setting> {};

TEST_P(BlendedShapes, CureAtTheirContours) {
  const Setting s = GetParam();
  const MachineProfile machine = judge_machine(s.spread_px);
  EdgeFigures all;
  for (const auto& shape : test::mask_shapes())
    all.add(test::judge(machine, blended(machine, s.tau, shape.rings), s.tau, shape.rings));
  EXPECT_LE(all.edges.mean_px(), s.mean_px);
  EXPECT_LE(all.smooth.mean_px(), s.smooth_px);
  EXPECT_LE(all.corners.mean_px(), s.corner_px);
  EXPECT_EQ(all.far_px2, 0);
}
INSTANTIATE_TEST_SUITE_P(Issue, BlendedShapes,
                         testing::Values(Setting{0.5, 0.5, 0.015, 0.004, 0.25}, Setting{0.5, 0.2, 0.015, 0.004, 0.25},
                                         Setting{1.0, 0.5, 0.03, 0.005, 0.35}, Setting{1.0, 0.2, 0.03, 0.005, 0.35}));

TEST(BlendedWalls, OfOnePixelKeepTheirWidthAtEveryOffsetAndAngle) {
  const MachineProfile machine = judge_machine(0.5);
  for (const bool gap : {false, true})
    for (const auto& feature : test::thin_features(1, gap)) {
      const auto kept = test::kept_width(test::exposed(machine, blended(machine, 0.5, feature.rings), 0.5), 1, feature);
      EXPECT_NEAR(kept.least_px, 1, 0.06) << gap;
      EXPECT_NEAR(kept.most_px, 1, 0.06) << gap;
    }
}

TEST(BlendedShapes, KeepTheirSmoothEdgesWhereTheMachineIsOffByWhatCalibrationLeaves) {
  // Dose off by 2 %, spread by 10 %, field by 2 % from side to side.
  const MachineProfile known = judge_machine(0.5);
  MachineProfile real = judge_machine(0.55);
  real.projection.field = {{0.98, 1.02}};
  EdgeFigures all;
  for (const auto& shape : test::mask_shapes())
    all.add(test::judge(real, blended(known, 0.5, shape.rings), 0.5 / 1.02, shape.rings));
  EXPECT_LE(all.smooth.mean_px(), 0.03);
}

TEST(BlendedShapes, UndoWhatCurveLeakAndFieldDo) {
  MachineProfile machine = judge_machine(0.5);
  machine.projection.gamma = 2.2;
  machine.projection.leak = 0.005;
  machine.projection.field = {{0.8, 1.0}, {0.9, 0.75}};
  EdgeFigures all;
  for (const auto& shape : test::mask_shapes())
    all.add(test::judge(machine, blended(machine, 0.5, shape.rings), 0.5, shape.rings));
  EXPECT_LE(all.edges.mean_px(), 0.02);
  EXPECT_LE(all.smooth.mean_px(), 0.005);
}

TEST(BlendedShapes, AreTheSameBytesWhereverTheTilesLie) {
  // The shape at one place, and a whole number of tiles and pixels away from it.
  MachineProfile machine = judge_machine(0.5);
  machine.platform = {400 * 0.05, 300 * 0.05, 50};
  const auto shape = test::mask_shapes()[27];
  std::vector<Contour> far;
  for (const Contour& ring : shape.rings) {
    std::vector<Point2> moved;
    for (const Point2 p : ring.vertices()) moved.push_back({p.x_mm + 131 * 0.05, p.y_mm + 77 * 0.05});
    far.push_back(Contour::from_vertices(std::move(moved)).value());
  }
  const Mask here = blended(machine, 0.5, shape.rings), there = blended(machine, 0.5, far);
  int most = 0;
  for (std::uint32_t y = 0; y < 96; ++y)
    for (std::uint32_t x = 0; x < 96; ++x)
      most = std::max(most, std::abs(here.rows[(299 - y) * 400 + x] - there.rows[(299 - y - 77) * 400 + x + 131]));
  EXPECT_LE(most, 1);  // a tile's border may turn a rounding
}

TEST(BlendedShapes, HaveNoSeamsBetweenTilesInWideSpots) {
  MachineProfile machine = judge_machine(3.0);
  const auto shape = test::mask_shapes()[12];
  const EdgeFigures figures = test::judge(machine, blended(machine, 0.5, shape.rings), 0.5, shape.rings);
  EXPECT_LE(figures.smooth.mean_px(), 0.02);
}

TEST(Blend, ReportsWhatItReachedAndKeepsCoverWhenTimeIsOut) {
  const MachineProfile machine = judge_machine(0.5);
  const auto shape = test::mask_shapes()[4];
  const auto solved =
      MaskBlender::make(mask_frame(machine), light_of(machine, 0.5), {}).value().blend({.part = shape.rings});
  EXPECT_GT(solved.figures.tiles, 0U);
  EXPECT_EQ(solved.figures.unsolved, 0U);
  EXPECT_GT(solved.figures.length_px, 20);
  EXPECT_LT(solved.figures.residual_px(), 0.02);
  const auto kept = MaskBlender::make(mask_frame(machine), light_of(machine, 0.5), {})
                        .value()
                        .blend({.part = shape.rings, .out_of_time = [] { return true; }});
  EXPECT_EQ(kept.mask, rasterise(shape.rings, mask_frame(machine)));
  EXPECT_EQ(kept.figures.tiles, 0U);
  EXPECT_EQ(kept.figures.unsolved, solved.figures.tiles);
}

TEST(Blend, GivesTheseBytesForAGear) {
  const MachineProfile machine = judge_machine(0.5);
  const Mask mask = blended(machine, 0.5, test::mask_shapes()[27].rings);
  EXPECT_EQ(to_hex(digest_of(std::as_bytes(std::span{mask.rows}))).substr(0, 16), "028ad588e8c68fe9");
}

TEST(Blend, RefusesOptionsOutOfRange) {
  const MachineProfile machine = judge_machine(0.5);
  const auto refused = [&](auto change) {
    BlendOptions options;
    change(options);
    const auto made = MaskBlender::make(mask_frame(machine), light_of(machine, 0.5), options);
    return !made && made.error().code == ErrorCode::InvalidInput;
  };
  EXPECT_TRUE(refused([](BlendOptions& o) { o.iterations = 0; }));
  EXPECT_TRUE(refused([](BlendOptions& o) { o.regular = 0; }));
  EXPECT_TRUE(refused([](BlendOptions& o) { o.corner_weight = 1.5; }));
  EXPECT_TRUE(refused([](BlendOptions& o) { o.support_grey = std::nan(""); }));
}

TEST(MaskLight, NamesTheKeyThatMakesNoSense) {
  MachineProfile machine = judge_machine(0.5);
  machine.resin.penetration_mm = 0;
  EXPECT_NE(mask_light(machine).error().what.find("resin.penetration_mm"), std::string::npos);
  machine = judge_machine(9);
  EXPECT_NE(mask_light(machine).error().what.find("projection.spread_px"), std::string::npos);
}

TEST(GreyEncoder, TakesTheGreyWhoseLightIsNearest) {
  MachineProfile machine = judge_machine(0.5);
  machine.projection.gamma = 2.2;
  machine.projection.leak = 0.01;
  const auto tone = tone_of(machine.projection);
  const GreyEncoder encode{tone};
  for (int i = 0; i <= 2000; ++i) {
    const double wanted = i / 2000.0;
    const double got = tone[encode(static_cast<float>(wanted))];
    for (const double other : tone) EXPECT_LE(std::abs(got - wanted), std::abs(other - wanted) + 1e-6);
  }
}

}  // namespace
}  // namespace telefab::fab
