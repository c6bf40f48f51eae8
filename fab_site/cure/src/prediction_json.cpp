// SPDX-License-Identifier: GPL-3.0-or-later
#include <nlohmann/json.hpp>
#include <telefab/base/json_text.hpp>
#include <telefab/fab/cure/prediction.hpp>

namespace telefab::fab {
namespace {

using nlohmann::ordered_json;

double rounded(double value) { return std::round(value * 1e5) / 1e5; }

ordered_json tally(const DistanceTally& t) {
  return {{"mean", rounded(t.mean_px())},          {"bias", rounded(t.bias_px())}, {"rms", rounded(t.rms_px())},
          {"p95", rounded(t.percentile_px(0.95))}, {"max", rounded(t.max_px())},   {"samples", t.count()}};
}

ordered_json figures(const EdgeFigures& f) {
  return {{"edge_px", tally(f.edges)},
          {"smooth_px", tally(f.smooth)},
          {"corner_px", tally(f.corners)},
          {"cured_to_contour_px", tally(f.cured)},
          {"lost_share", rounded(f.lost_share())},
          {"px_per_percent_dose", rounded(f.latitude_px())},
          {"area_px2",
           {{"target", rounded(f.target_px2)},
            {"cured", rounded(f.cured_px2)},
            {"excess", rounded(f.excess_px2)},
            {"missing", rounded(f.missing_px2)},
            {"farther_than_1px", rounded(f.far_px2)}}}};
}

}  // namespace

PredictionBand band_of(const Prediction& prediction, const CalibrationBand& calibration) {
  constexpr double kPercent = 100;
  return {calibration, kPercent * calibration.dose_share * prediction.edges.latitude_px(),
          (calibration.most_depth_mm - calibration.least_depth_mm) / 2};
}

std::string to_json(const Prediction& p, const CureModel& model, const std::optional<PredictionBand>& band) {
  ordered_json layers = ordered_json::array();
  for (std::size_t i = 0; i < p.layers.size(); ++i) {
    const EdgeFigures& f = p.layers[i];
    layers.push_back({{"layer", i},
                      {"edge_mean_px", rounded(f.edges.mean_px())},
                      {"edge_bias_px", rounded(f.edges.bias_px())},
                      {"edge_p95_px", rounded(f.edges.percentile_px(0.95))},
                      {"edge_max_px", rounded(f.edges.max_px())},
                      {"smooth_mean_px", rounded(f.smooth.mean_px())},
                      {"excess_px2", rounded(f.excess_px2)},
                      {"missing_px2", rounded(f.missing_px2)},
                      {"farther_than_1px_px2", rounded(f.far_px2)}});
  }
  ordered_json open;  // null where nobody measured
  if (band)
    open = {{"dose_95_share", rounded(band->calibration.dose_share)},
            {"cure_depth_95_mm", {rounded(band->calibration.least_depth_mm), rounded(band->calibration.most_depth_mm)}},
            {"edges_95_px", rounded(band->edges_px)},
            {"undersides_95_mm", rounded(band->undersides_mm)}};
  const ordered_json value{{"model",
                            {{"pixel_pitch_mm", model.pixel_pitch_mm},
                             {"layer_mm", model.layer_mm},
                             {"spread_px", model.spread_px},
                             {"penetration_mm", model.penetration_mm},
                             {"white_ec_per_s", model.white_per_s},
                             {"leak", model.leak}}},
                           {"print_layers", p.solid.layers.size()},
                           {"surface_points", p.points.size()},
                           {"support_points", p.support_points},
                           {"digest", to_hex(p.solid.digest)},
                           {"cured_mm3", rounded(p.solid.volume_mm3)},
                           {"contour_mm3", rounded(p.contour_mm3)},
                           {"edge_mean_mm", rounded(p.edges.edges.mean_px() * model.pixel_pitch_mm)},
                           {"overall", figures(p.edges)},
                           {"underside_layers", tally(p.undersides)},
                           {"calibration", open},
                           {"underside_bias_mm", rounded(p.undersides.bias_px() * model.layer_mm)},
                           {"layers", layers}};
  return json_text(value, 1) + "\n";
}

}  // namespace telefab::fab
