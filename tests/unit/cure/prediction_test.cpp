// SPDX-License-Identifier: GPL-3.0-or-later
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <nlohmann/json.hpp>
#include <telefab/fab/cure/prediction.hpp>
#include <telefab/fab/mask/raster.hpp>

#include "lit_plates.hpp"

namespace telefab::fab::test {
namespace {

using testing::HasSubstr;

Contour box_mm(double x0, double y0, double x1, double y1) {
  return Contour::from_vertices({{x0, y0}, {x1, y0}, {x1, y1}, {x0, y1}}).value();
}

/// A table on plate_machine(): a foot of 12 layers, a plate of 8 that hangs 1.4 mm over it; every layer lit for 1.36 s,
/// so that one exposure cures two layers deep.
class PredictedTable : public testing::Test {
 protected:
  PredictedTable() {
    machine.layers.exposure_s = 1.35914;
    for (std::uint32_t i = 0; i < 20; ++i) {
      Layer layer;
      layer.index = LayerIndex{i};
      layer.contours = {i < 12 ? box_mm(1, 1, 3, 3.5) : box_mm(1, 1, 4.4, 3.5)};
      layers.push_back(layer);
    }
    model = cure_model(machine).value();
    print.layers = 20;
    print.part = layers;
    print.light = [this](LayerIndex i) -> Result<LitLayer> {
      return lit(rasterise(layers[i.count()].contours, mask_frame(machine)), 1359140us);
    };
  }
  [[nodiscard]] Prediction predicted(PredictOptions options = {}) const {
    auto prediction = predict_print(model, print, options, {}, {});
    EXPECT_TRUE(prediction) << prediction.error().what;
    return std::move(*prediction);
  }
  MachineProfile machine = plate_machine();
  CureModel model;
  std::vector<Layer> layers;
  PrintToPredict print;
};

TEST_F(PredictedTable, UndersidesSinkByWhatTheLayersAboveLetThrough) {
  const Prediction p = predicted();
  // Eight layers over the void: their light adds up to white (1 - q^8) / (1 - q), less one layer's own thickness.
  const double q = std::exp(-0.5), dose = 2 * 1.35914 * (1 - std::pow(q, 8)) / (1 - q);
  EXPECT_NEAR(p.undersides.bias_px(), 0.2 * std::log(dose) / 0.1 - 1, 0.01);
  EXPECT_NEAR(p.undersides.mean_px(), p.undersides.bias_px(), 1e-9);
  EXPECT_GT(p.undersides.count(), 100);
}

TEST_F(PredictedTable, WallsGrowByTheLightFromAbove) {
  const Prediction p = predicted();
  // Half way down the foot the plate is far above: a stack of equal layers, in closed form 0.5 phi^-1(1 - share).
  const double share = 2 * std::sinh(0.25) / (2 * 1.35914);
  double low = 0, high = 5;
  for (int i = 0; i < 60; ++i) {
    const double t = (low + high) / 2;
    ((1 + std::erf(t / std::sqrt(2.0))) / 2 < 1 - share ? low : high) = t;
  }
  EXPECT_NEAR(p.layers[0].smooth.bias_px(), 0.5 * low, 0.02);
  EXPECT_GT(p.solid.volume_mm3, p.contour_mm3);
  EXPECT_NEAR(p.contour_mm3, 0.1 * 2.5 * (12 * 2.0 + 8 * 3.4), 0.02);
}

TEST_F(PredictedTable, PointsLieOnItsSixSidesAndTheLightLeaksNowhere) {
  const Prediction p = predicted();
  double top = 0, bottom = 0, walls = 0, under = 0;
  for (const SurfacePoint& s : p.points) {
    EXPECT_NEAR(std::hypot(s.normal_x, s.normal_y, s.normal_z), 1, 1e-5);
    EXPECT_TRUE(s.x_mm > 0.85F && s.x_mm < 4.55F && s.y_mm > 0.85F && s.y_mm < 3.65F);
    if (s.normal_z > 0.99F && s.z_mm > 1.99F) ++top;
    if (s.normal_z < -0.99F && s.z_mm == 0) ++bottom;
    if (std::abs(s.normal_z) < 0.5F) ++walls;
    if (s.normal_z < -0.9F && s.z_mm > 0.5F && s.z_mm < 1.2F) ++under;
  }
  EXPECT_NEAR(top, 34 * 25, 120);     // a point a pixel
  EXPECT_NEAR(bottom, 20 * 25, 100);  // edges grow by most of a pixel
  EXPECT_NEAR(under, 14 * 25, 100);
  EXPECT_NEAR(walls, 12 * 2 * (20 + 25) + 8 * 2 * (34 + 25), 250);
}

TEST_F(PredictedTable, SupportsAreLeftOutUnlessWanted) {
  const Contour pillar = box_mm(3.6, 2, 4.2, 2.6);
  std::vector<std::vector<Contour>> supports(20);
  for (std::size_t i = 0; i < 12; ++i) supports[i] = {pillar};
  print.supports = supports;
  print.light = [&](LayerIndex i) -> Result<LitLayer> {
    auto rings = layers[i.count()].contours;
    if (i.count() < 12) rings.push_back(pillar);
    return lit(rasterise(rings, mask_frame(machine)), 1359140us);
  };
  const auto in_pillar = [](const Prediction& p) {
    return std::count_if(p.points.begin(), p.points.end(), [](const SurfacePoint& s) {
      return s.x_mm > 3.4F && s.x_mm < 4.4F && s.y_mm > 1.8F && s.y_mm < 2.8F && s.z_mm < 0.8F;
    });
  };
  PredictOptions with;
  with.supports = true;
  const Prediction bare = predicted(), full = predicted(with);
  EXPECT_EQ(in_pillar(bare), 0);
  EXPECT_GT(in_pillar(full), 150);
  EXPECT_EQ(bare.support_points, full.support_points);
  EXPECT_EQ(full.points.size(), bare.points.size() + bare.support_points);
}

TEST_F(PredictedTable, IsTheSameOnAnyNumberOfThreads) {
  PredictOptions options;
  options.threads = 1;
  const Prediction one = predicted(options);
  options.threads = 2;
  const Prediction two = predicted(options);
  EXPECT_EQ(one.points, two.points);
  EXPECT_EQ(to_json(one, model, {}), to_json(two, model, {}));
  EXPECT_EQ(one.picture, two.picture);
}

TEST_F(PredictedTable, ReportsInJsonWhatItFound) {
  const Prediction p = predicted();
  const auto report = nlohmann::json::parse(to_json(p, model, {}));
  EXPECT_EQ(report["layers"].size(), 20U);
  EXPECT_NEAR(report["underside_layers"]["bias"], p.undersides.bias_px(), 1e-5);
  EXPECT_EQ(report["digest"], to_hex(p.solid.digest));
}

TEST_F(PredictedTable, WritesPlyThatSaysWhatItHolds) {
  const Prediction p = predicted();
  const auto bytes = to_ply(p.points, "test");
  const std::string text{reinterpret_cast<const char*>(bytes.data()), 200};
  EXPECT_THAT(text, HasSubstr("element vertex " + std::to_string(p.points.size())));
  EXPECT_EQ(bytes.size(), text.find("end_header\n") + 11 + 24 * p.points.size());
}

TEST_F(PredictedTable, RefusesContoursOfAnotherPlan) {
  print.elevation_layers = 3;
  EXPECT_THAT(predict_print(model, print, {}, {}, {}).error().what, HasSubstr("stand on 3"));
  print.elevation_layers = 0;
  PredictOptions options;
  options.picture = LayerIndex{20};
  EXPECT_THAT(predict_print(model, print, options, {}, {}).error().what, HasSubstr("no layer 20"));
}

TEST_F(PredictedTable, StopsWhenAsked) {
  std::stop_source stop;
  stop.request_stop();
  EXPECT_EQ(predict_print(model, print, {}, {}, stop.get_token()).error().code, ErrorCode::Cancelled);
}

}  // namespace
}  // namespace telefab::fab::test
