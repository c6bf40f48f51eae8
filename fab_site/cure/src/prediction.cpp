// SPDX-License-Identifier: GPL-3.0-or-later
#include <fmt/format.h>
#include <tbb/parallel_for.h>

#include <algorithm>
#include <iterator>
#include <nlohmann/json.hpp>
#include <telefab/fab/cure/prediction.hpp>

#include "point_owner.hpp"
#include "prediction_picture.hpp"
#include "underside_watch.hpp"

namespace telefab::fab {
namespace {

/// What one layer leaves behind; written by index.
struct LayerOutcome {
  RingIndex part{{}, 1};
  RingIndex supports{{}, 1};
  std::vector<SurfacePoint> points;
  std::vector<SurfacePoint> support_points;  ///< for the picture
  EdgeFigures edges;
  std::vector<EdgeSample> samples;
};

std::span<const Contour> part_rings(const PrintToPredict& print, LayerIndex index) {
  const std::uint32_t i = index.count();
  if (i < print.elevation_layers || i - print.elevation_layers >= print.part.size()) return {};
  return print.part[i - print.elevation_layers].contours;
}

std::span<const Contour> support_rings(const PrintToPredict& print, LayerIndex index) {
  if (index.count() >= print.supports.size()) return {};
  return print.supports[index.count()];
}

LayerIndex most_contour(const PrintToPredict& print) {
  double most = -1;
  std::uint32_t best = 0;
  for (const Layer& layer : print.part) {
    double length = 0;
    for (const Contour& ring : layer.contours) length += ring.length_mm();
    if (length <= most) continue;
    most = length;
    best = layer.index.count();
  }
  return LayerIndex{best + print.elevation_layers};
}

Result<void> check(const PrintToPredict& print, const PredictOptions& options) {
  if (auto ok = options.validate(); !ok) return ok;
  if (!print.part.empty() && print.part.size() + print.elevation_layers != print.layers)
    return fail(ErrorCode::InvalidInput,
                fmt::format("the contours have {} layers and stand on {}, the plan has {}; they are not of this plan",
                            print.part.size(), print.elevation_layers, print.layers));
  if (!print.supports.empty() && print.supports.size() != print.layers)
    return fail(ErrorCode::InvalidInput, fmt::format("supports of {} layers in a plan of {}; plan the job again",
                                                     print.supports.size(), print.layers));
  if (options.picture && options.picture->count() >= print.layers)
    return fail(ErrorCode::InvalidInput,
                fmt::format("no layer {}; the plan has {}", options.picture->count(), print.layers));
  return {};
}

}  // namespace

Result<void> PredictOptions::validate() const {
  if (spacing_px < 1 || spacing_px > 64)
    return fail(ErrorCode::InvalidInput, fmt::format("points {} px apart; 1 to 64 are possible", spacing_px));
  CureOptions cure;
  cure.sub_pixels = sub_pixels;
  cure.threads = threads;
  return cure.validate();
}

Result<Prediction> predict_print(const CureModel& model, const PrintToPredict& print, const PredictOptions& options,
                                 const ProgressSink& progress, std::stop_token stop) {
  if (auto ok = check(print, options); !ok) return tl::unexpected{ok.error()};
  Prediction prediction;
  prediction.pictured = options.picture.value_or(most_contour(print));
  std::vector<LayerOutcome> outcomes(print.layers);
  UndersideWatch undersides{model};
  PointOwner owner{model.mask};
  EdgeOptions edge_options;
  edge_options.sample_px = 1;
  edge_options.sub_pixels = std::min(2, options.sub_pixels);

  const LightSource source = [&](LayerIndex index) {
    LayerOutcome& outcome = outcomes[index.count()];
    outcome.part = RingIndex{part_rings(print, index), model.pixel_pitch_mm};
    outcome.supports = RingIndex{support_rings(print, index), model.pixel_pitch_mm};
    return print.light(index);
  };
  CureOptions cure;
  cure.sub_pixels = options.sub_pixels;
  cure.threads = options.threads;
  cure.in_order = [&](LayerIndex index, const DoseField& dose) -> Result<void> {
    undersides.descend(dose, outcomes[index.count()].part, outcomes[index.count()].supports);
    return {};
  };
  cure.each = [&](const CuredLayer& layer) -> Result<void> {
    LayerOutcome& outcome = outcomes[layer.index.count()];
    outcome.points = surface_points(layer, options.spacing_px);
    const EdgeTarget target{part_rings(print, layer.index), support_rings(print, layer.index)};
    if (print.part.empty()) return {};
    auto figures = measure_edges(layer.dose, model.to_middle(), target, model.pixel_pitch_mm, edge_options,
                                 layer.index == prediction.pictured ? &outcome.samples : nullptr);
    if (!figures) return tl::unexpected{figures.error()};
    outcome.edges = std::move(*figures);
    return {};
  };
  // The indices of a layer take megabytes: they go as soon as its points have found their owners.
  cure.done = [&](LayerIndex index) {
    LayerOutcome& outcome = outcomes[index.count()];
    owner.descend(outcome.part, outcome.supports);
    const auto of_support = [&](const SurfacePoint& p) {
      return owner.is_support({p.x_mm / model.pixel_pitch_mm, p.y_mm / model.pixel_pitch_mm}, outcome.part,
                              outcome.supports);
    };
    std::ranges::copy_if(outcome.points, std::back_inserter(outcome.support_points), of_support);
    prediction.support_points += static_cast<std::size_t>(
        options.supports ? std::count_if(outcome.points.begin(), outcome.points.end(), of_support)
                         : static_cast<std::ptrdiff_t>(std::erase_if(outcome.points, of_support)));
    outcome.points.shrink_to_fit();
    outcome.part = RingIndex{{}, 1};
    outcome.supports = RingIndex{{}, 1};
  };
  auto solid = cure_solid(model, print.layers, source, cure, progress, stop);
  if (!solid) return tl::unexpected{solid.error()};
  prediction.solid = std::move(*solid);
  undersides.finish();
  prediction.undersides = undersides.errors();
  for (std::size_t i = 0; i < outcomes.size(); ++i) {
    prediction.contour_mm3 +=
        outcomes[i].edges.target_px2 * model.pixel_pitch_mm * model.pixel_pitch_mm * model.layer_mm;
    if (i < print.elevation_layers) continue;
    prediction.edges.add(outcomes[i].edges);
    prediction.layers.push_back(outcomes[i].edges);
  }
  std::size_t points = 0;
  for (const LayerOutcome& outcome : outcomes) points += outcome.points.size();
  prediction.points.reserve(points);
  for (LayerOutcome& outcome : outcomes) {
    prediction.points.insert(prediction.points.end(), outcome.points.begin(), outcome.points.end());
    std::vector<SurfacePoint>{}.swap(outcome.points);
  }
  std::vector<SurfacePoint> supports;
  for (LayerOutcome& outcome : outcomes)
    supports.insert(supports.end(), outcome.support_points.begin(), outcome.support_points.end());
  if (print.layers > 0)
    prediction.picture = draw_prediction(prediction.points, supports, outcomes[prediction.pictured.count()].samples,
                                         prediction.pictured, model, options.caption);
  return prediction;
}

}  // namespace telefab::fab
