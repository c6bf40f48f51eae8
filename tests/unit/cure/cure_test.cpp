// SPDX-License-Identifier: GPL-3.0-or-later
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <numbers>
#include <telefab/fab/mask/raster.hpp>

#include "lit_plates.hpp"

namespace telefab::fab::test {
namespace {

using testing::HasSubstr;

double phi(double x) { return (1 + std::erf(x / std::numbers::sqrt2)) / 2; }

TEST(PixelKernel, SumsToOneAtEveryFractionAndFollowsTheErfs) {
  for (const double spread : {0.1, 0.5, 1.0, 5.0}) {
    const PixelKernel kernel{spread};
    std::vector<float> weights(static_cast<std::size_t>(kernel.padded())), slopes(weights.size());
    for (const double fraction : {0.0, 0.123, 0.5, 0.999, 1.0}) {
      kernel.weights(fraction, weights, slopes);
      double sum = 0;
      for (std::size_t i = 0; i < weights.size(); ++i) {
        sum += static_cast<double>(weights[i]);
        const double t = fraction - (static_cast<double>(i) - kernel.reach() + 0.5);
        if (static_cast<int>(i) <= 2 * kernel.reach()) {
          EXPECT_NEAR(weights[i], PixelKernel::exact(t, spread), spread < 0.3 ? 1e-4 : 1e-5);
        }
      }
      EXPECT_NEAR(sum, 1, 1e-5);
    }
  }
}

TEST(DoseField, OfAHalfPlaneIsTheErrorFunction) {
  MachineProfile machine = plate_machine();
  for (const double spread : {0.4, 0.5, 1.0}) {
    machine.projection.spread_px = spread;
    const CureModel model = cure_model(machine).value();
    const DoseField field = field_of(model, mask_of(model.mask, [](int c, int) { return c < 30 ? 255 : 0; }), 1s);
    for (double x = 27; x < 33; x += 0.17) {
      const auto sample = field.sample({x, 24.3});
      EXPECT_NEAR(sample.dose, 2 * phi((30 - x) / spread), 2e-5);
      const double t = (x - 30) / spread;
      EXPECT_NEAR(sample.slope_x, -2 * std::exp(-t * t / 2) / (spread * std::sqrt(2 * std::numbers::pi)), 5e-3);
      EXPECT_NEAR(sample.slope_y, 0, 1e-4);
    }
  }
}

TEST(DoseField, KeepsTheMasksOrientation) {  // the first row of a mask lies at the back
  const CureModel model = cure_model(plate_machine()).value();
  const DoseField field =
      field_of(model, mask_of(model.mask, [](int c, int r) { return c < 9 && r < 5 ? 255 : 0; }), 1s);
  EXPECT_NEAR(field.sample({5, 45.5}).dose, 2, 1e-4);
  EXPECT_NEAR(field.sample({5, 2.5}).dose, 0, 1e-4);
  EXPECT_NEAR(field.sample({9, 45.5}).dose, 1, 1e-4);
}

TEST(DoseField, OfADiscIsTheBlurredDisc) {
  MachineProfile machine = plate_machine();
  machine.projection.spread_px = 1;
  const CureModel model = cure_model(machine).value();
  const double radius = 10, cx = 31.3, cy = 23.8;
  std::vector<Point2> ring;
  for (int i = 0; i < 720; ++i) {
    const double a = 2 * std::numbers::pi * i / 720;
    ring.push_back({0.1 * (cx + radius * std::cos(a)), 0.1 * (cy + radius * std::sin(a))});
  }
  const Contour disc = Contour::from_vertices(ring).value();
  const DoseField field = field_of(model, rasterise({&disc, 1}, mask_frame(machine)), 500ms);
  // Area coverage and the pixel itself are a box each: their variances add to the Gaussian's. What
  // sampling once a pixel aliases into the blur's band is some .006 at an edge that leans a little.
  const double variance = 1 + 2.0 / 12;
  for (double r = 7; r < 13; r += 0.5) {
    double blurred = 0;
    constexpr int n = 4000;
    for (int i = 0; i < n; ++i) {
      const double rho = radius * (i + 0.5) / n, z = rho * r / variance;
      blurred += rho / variance * std::exp(-(rho - r) * (rho - r) / (2 * variance)) *
                 (std::cyl_bessel_i(0, z) * std::exp(-z)) * radius / n;
    }
    for (const double a : {0.1, 1.3, 4.0})
      EXPECT_NEAR(field.sample({cx + r * std::cos(a), cy + r * std::sin(a)}).dose, blurred, 8e-3) << r;
  }
}

TEST(DoseStream, AddsTheLightThatPassedTheLayersAbove) {  // against the recursion at points, with erf alone
  MachineProfile machine = plate_machine();
  machine.projection.leak = 0.01;
  machine.projection.gamma = 2.2;
  machine.projection.field = {{1, 0.9, 0.8}, {0.7, 0.95, 0.6}};
  const CureModel model = cure_model(machine).value();
  const auto mask = [&](int layer) {
    return mask_of(model.mask, [=](int c, int r) { return (c * 7 + r * 13 + layer * 31) % 256; });
  };
  DoseStream stream{model};
  const PixelPlace place{20.37, 11.81};
  double expected = 0;
  for (int layer = 9; layer >= 0; --layer) {
    const Mask shown = mask(layer);
    const MaskExposure exposure{shown.view(), 700ms};
    const DoseField field = stream.descend({&exposure, 1}).value();
    double light = 0;
    for (int r = 0; r < 48; ++r)
      for (int c = 0; c < 64; ++c) {
        const double h = std::pow(shown.rows[static_cast<std::size_t>(r * 64 + c)] / 255.0, 2.2);
        light += field_at(machine.projection, (c + 0.5) / 64, (r + 0.5) / 48) * (0.01 + 0.99 * h) *
                 PixelKernel::exact(place.x_px - (c + 0.5), 0.5) *
                 PixelKernel::exact(place.y_px - (48 - 1 - r + 0.5), 0.5);
      }
    expected = 0.7 * 2 * light + std::exp(-0.5) * expected;
    EXPECT_NEAR(field.sample(place).dose, expected, 3e-5 * expected);
  }
}

TEST(DoseStream, AWallOfEqualLayersIsCuredFromTwoSinhOverWhite) {
  const MachineProfile machine = plate_machine();
  const CureModel model = cure_model(machine).value();
  const Mask half = mask_of(model.mask, [](int c, int) { return c < 30 ? 255 : 0; });
  DoseStream stream{model};
  const MaskExposure exposure{half.view(), 1400ms};
  DoseField field = stream.descend({&exposure, 1}).value();
  for (int i = 0; i < 60; ++i) field = stream.descend({&exposure, 1}).value();
  const double share = 2 * std::sinh(0.1 / (2 * 0.2)) / (1.4 * 2);
  // phi^-1 by bisection.
  double low = -5, high = 5;
  for (int i = 0; i < 80; ++i) (phi((low + high) / 2) < share ? low : high) = (low + high) / 2;
  const double edge = 30 - low * 0.5;
  EXPECT_NEAR(field.sample({edge, 24}).dose, model.to_middle(), 1e-4);
}

TEST(DepthMap, OneExposureCuresToJacobsDepth) {
  MachineProfile machine = plate_machine();
  machine.layers.thickness_mm = 1;
  const CureModel model = cure_model(machine).value();
  for (const auto time : {400ms, 600ms, 5000ms, 10000ms}) {
    const DepthMap map =
        DepthMap::of(field_of(model, mask_of(model.mask, [](int, int) { return 255; }), time), model, 4);
    const double dose = 2 * std::chrono::duration<double>(time).count();
    const double depth_mm = std::max(0.0, 0.2 * std::log(dose));
    const auto at = [&](int x, int y) -> double {
      for (const DepthMap::Tile& tile : map.tiles())
        if (tile.x == x && tile.y == y) return map.depths(tile)[5] / double{DepthMap::kWhole};
      return 0;
    };
    EXPECT_NEAR(at(32, 24), depth_mm, 1e-4) << dose;
  }
}

TEST(DepthMap, CuresNoDeeperThanTheLayer) {
  const CureModel model = cure_model(plate_machine()).value();
  const DepthMap map =
      DepthMap::of(field_of(model, mask_of(model.mask, [](int c, int) { return c < 32 ? 255 : 0; }), 10s), model, 3);
  double whole = 0;
  for (const DepthMap::Tile& tile : map.tiles()) whole += tile.whole;
  EXPECT_GT(whole, 10);
  // 32 x 48 pixels and the growth of the edges by light of twenty times Ec.
  EXPECT_GT(map.volume(), 32 * 48);
  EXPECT_LT(map.volume(), 33.2 * 50.4);
}

TEST(CureModel, RefusesFiguresThatAreNotPositiveAndNamesTheKey) {
  MachineProfile machine = plate_machine();
  machine.resin.penetration_mm = 0;
  EXPECT_THAT(cure_model(machine).error().what, HasSubstr("resin.penetration_mm"));
  machine = plate_machine();
  machine.projection.spread_px = 7;
  EXPECT_THAT(cure_model(machine).error().what, HasSubstr("projection.spread_px"));
}

TEST(DoseStream, RefusesMasksOfAnotherSizeAndNegativeTimes) {
  const CureModel model = cure_model(plate_machine()).value();
  DoseStream stream{model};
  const Mask small = mask_of({10, 10}, [](int, int) { return 255; });
  const MaskExposure wrong{small.view(), 1s};
  EXPECT_THAT(stream.descend({&wrong, 1}).error().what, HasSubstr("10 x 10"));
  const Mask full = mask_of(model.mask, [](int, int) { return 255; });
  const MaskExposure negative{full.view(), -1s};
  EXPECT_FALSE(stream.descend({&negative, 1}));
}

class RecordedPrint : public testing::Test {
 protected:
  RecordedPrint() {
    for (int k = 0; k < 3; ++k)
      masks.push_back(mask_of(model.mask, [k](int c, int r) { return c > 8 + 2 * k && c < 50 && r > 9 ? 255 : 0; }));
  }
  [[nodiscard]] static Digest digest(const Mask& mask) { return digest_of(std::as_bytes(std::span{mask.rows})); }
  [[nodiscard]] LitRecord record(std::size_t layer, std::chrono::nanoseconds time) const {
    return {digest(masks[layer]), 0.1 * static_cast<double>(layer + 1) + 0.002, time};
  }
  [[nodiscard]] Result<CuredSolid> cured(std::vector<LitRecord> records) const {
    return cure_recorded(model, records,
                         [this](const Digest& wanted) -> Result<Mask> {
                           for (const Mask& mask : masks)
                             if (digest(mask) == wanted) return mask;
                           return fail(ErrorCode::NotFound, "no such mask");
                         },
                         {});
  }
  CureModel model = cure_model(plate_machine()).value();
  std::vector<Mask> masks;
};

TEST_F(RecordedPrint, AnInterruptedAndResumedPrintIsTheSameSolid) {
  const auto whole = cured({record(0, 2s), record(1, 2s), record(2, 2s)});
  const auto resumed = cured({record(0, 2s), record(1, 700ms), record(1, 1300ms), record(2, 2s)});
  ASSERT_TRUE(whole && resumed);
  EXPECT_EQ(whole->digest, resumed->digest);
  EXPECT_FALSE(whole->first_difference(*resumed));
  EXPECT_GT(whole->volume_mm3, 3 * 0.1 * 3.5 * 3.5);
}

TEST_F(RecordedPrint, ALayerLitTwiceOrTooShortIsAnotherSolidAndIsNamed) {
  const auto whole = cured({record(0, 2s), record(1, 2s), record(2, 2s)});
  const auto twice = cured({record(0, 2s), record(1, 2s), record(1, 2s), record(2, 2s)});
  const auto brief = cured({record(0, 2s), record(1, 2s), record(2, 1990ms)});
  ASSERT_TRUE(whole && twice && brief);
  EXPECT_NE(whole->digest, twice->digest);
  EXPECT_NE(whole->digest, brief->digest);
  EXPECT_TRUE(whole->first_difference(*brief));
  EXPECT_EQ(twice->first_difference(*whole)->count(), 0U);  // light goes down through the layers below
}

TEST_F(RecordedPrint, LightBetweenTheLayersIsRefused) {
  LitRecord record_between = record(1, 2s);
  record_between.z_mm = 0.15;
  EXPECT_THAT(cured({record_between}).error().what, HasSubstr("0.15 mm"));
}

}  // namespace
}  // namespace telefab::fab::test
