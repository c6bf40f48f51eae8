// SPDX-License-Identifier: GPL-3.0-or-later
#include <tbb/parallel_for.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <nlohmann/json.hpp>
#include <numeric>
#include <telefab/base/json_text.hpp>
#include <telefab/fab/cure/feature_watch.hpp>

namespace telefab::fab {
namespace {

constexpr double kNarrow_px = 2;        // wider ones bear any dose a machine may give
constexpr double kStep_px = 2;          // along contours
constexpr double kForgotten = 100;      // light counts until this little of it is left
constexpr double kNeighbour_px = 3;     // the same feature in the next layer
constexpr double kHairless = 1 - 1e-6;  // a wall of one pixel is one, whatever the rounding
constexpr std::size_t kMostListed = 100;
constexpr std::size_t kMostTaps = 64;  // of the widest kernel, padded

void keep_narrowest(std::vector<NarrowPlace>& places, std::size_t most) {
  if (places.size() <= most) return;
  std::vector<std::size_t> order(places.size());
  std::iota(order.begin(), order.end(), std::size_t{0});
  std::sort(order.begin(), order.end(), [&](std::size_t a, std::size_t b) {
    return std::pair{places[a].width_mm, a} < std::pair{places[b].width_mm, b};
  });
  order.resize(most);
  std::sort(order.begin(), order.end());
  std::vector<NarrowPlace> kept;
  for (const std::size_t i : order) kept.push_back(places[i]);
  places = std::move(kept);
}

bool is_weaker(const ThinFeature& a, const ThinFeature& b) { return *a.latitude < *b.latitude; }

nlohmann::ordered_json json_of(const ThinFeature& f) {
  nlohmann::ordered_json value{{"layer", f.layer.count()},
                               {"place", {f.place.middle.x_mm, f.place.middle.y_mm}},
                               {"width_mm", f.place.width_mm}};
  if (f.latitude) value["latitude"] = *f.latitude;
  return value;
}

nlohmann::ordered_json json_of(const ThinFigures& f) {
  nlohmann::ordered_json value{{"fine_layers", f.fine_layers}, {"fine_mm", f.fine_mm}, {"weak_layers", f.weak_layers}};
  if (f.narrowest) value["narrowest"] = json_of(*f.narrowest);
  if (f.weakest) value["weakest"] = json_of(*f.weakest);
  return value;
}

}  // namespace

FeatureWatch::FeatureWatch(std::span<const Layer> part, std::uint32_t elevation_layers, double pixel_pitch_mm,
                           std::optional<CureModel> model)
    : part_{part},
      elevation_layers_{elevation_layers},
      pitch_mm_{pixel_pitch_mm},
      model_{std::move(model)},
      layers_(part.size() + elevation_layers) {
  report_.dose_known = model_.has_value();
  if (!model_) return;
  kernel_.emplace(model_->spread_px);
  reach_ = static_cast<std::uint32_t>(
      std::clamp(std::ceil(std::log(kForgotten) * model_->penetration_mm / model_->layer_mm), 1.0, 64.0));
}

void FeatureWatch::look(std::uint32_t until) {
  until = std::min(until, static_cast<std::uint32_t>(layers_.size()));
  if (until <= looked_) return;
  tbb::parallel_for(looked_, until, [&](std::uint32_t i) {
    if (i < elevation_layers_) return;
    Watched& layer = layers_[i];
    layer.places = narrow_places(part_[i - elevation_layers_].contours, kNarrow_px * pitch_mm_, kStep_px * pitch_mm_);
    keep_narrowest(layer.places, kMostPlaces);
    layer.dose.assign(layer.places.size(), 0);
  });
  looked_ = until;
}

std::uint32_t FeatureWatch::lowest_lit(std::uint32_t print_layer) const {
  return std::max(elevation_layers_, print_layer > reach_ ? print_layer - reach_ : 0);
}

double FeatureWatch::light_at(const MaskExposure& exposure, Point2 place) const {
  const int width = static_cast<int>(exposure.mask.size.width_px);
  const int height = static_cast<int>(exposure.mask.size.height_px);
  const double x = place.x_mm / pitch_mm_, y = place.y_mm / pitch_mm_;
  if (!(x >= 0 && x < width && y >= 0 && y < height)) return 0;
  const int column = static_cast<int>(x), row = static_cast<int>(y), reach = kernel_->reach();
  const auto taps = static_cast<std::size_t>(kernel_->padded());
  std::array<float, kMostTaps> wx, wy, unused;
  kernel_->weights(x - column, {wx.data(), taps}, {unused.data(), taps});
  kernel_->weights(y - row, {wy.data(), taps}, {unused.data(), taps});
  double light = 0;
  for (int j = std::max(0, row - reach); j <= std::min(height - 1, row + reach); ++j) {
    const std::uint8_t* greys =
        exposure.mask.rows.data() + static_cast<std::ptrdiff_t>(height - 1 - j) * static_cast<std::ptrdiff_t>(width);
    double sum = 0;
    for (int i = std::max(0, column - reach); i <= std::min(width - 1, column + reach); ++i)
      sum += static_cast<double>(wx[static_cast<std::size_t>(i - column + reach)] * model_->tone[greys[i]]);
    light += static_cast<double>(wy[static_cast<std::size_t>(j - row + reach)]) * sum;
  }
  // The field hardly changes within a spot.
  return light * field_at(model_->projection, x / width, 1 - y / height) * model_->white_per_s *
         std::chrono::duration<double>(exposure.lit).count();
}

std::vector<float> FeatureWatch::light_of(std::uint32_t print_layer, const MaskExposure& exposure) const {
  std::vector<float> light;
  if (!model_ || print_layer < elevation_layers_) return light;
  for (std::uint32_t i = lowest_lit(print_layer); i <= print_layer; ++i)
    for (const NarrowPlace& place : layers_[i].places)
      light.push_back(static_cast<float>(light_at(exposure, place.middle)));
  return light;
}

void FeatureWatch::add(std::uint32_t print_layer, std::span<const float> light) {
  if (print_layer < elevation_layers_) {
    judged_ = print_layer + 1;
    return;
  }
  if (model_) {
    std::size_t at = 0;
    for (std::uint32_t i = lowest_lit(print_layer); i <= print_layer; ++i) {
      const double passed = std::pow(model_->passed(), print_layer - i);
      for (double& dose : layers_[i].dose) dose += passed * static_cast<double>(light[at++]);
    }
  }
  while (judged_ + reach_ <= print_layer) judge(judged_++);
}

ThinReport FeatureWatch::finish() {
  while (judged_ < layers_.size()) judge(judged_++);
  std::stable_sort(report_.weak.begin(), report_.weak.end(), is_weaker);
  return std::move(report_);
}

bool FeatureWatch::has_neighbour(std::uint32_t print_layer, const NarrowPlace& place) const {
  const double most = kNeighbour_px * pitch_mm_;
  const auto is_near = [&](const NarrowPlace& other) {
    return other.kind == place.kind && std::abs(other.middle.x_mm - place.middle.x_mm) < most &&
           std::abs(other.middle.y_mm - place.middle.y_mm) < most;
  };
  return (print_layer > 0 && std::ranges::any_of(layers_[print_layer - 1].places, is_near)) ||
         (print_layer + 1 < layers_.size() && std::ranges::any_of(layers_[print_layer + 1].places, is_near));
}

void FeatureWatch::judge(std::uint32_t print_layer) {
  const Watched& layer = layers_[print_layer];
  for (const auto kind : {NarrowPlace::Kind::Wall, NarrowPlace::Kind::Gap}) {
    ThinFigures& figures = kind == NarrowPlace::Kind::Wall ? report_.walls : report_.gaps;
    double fine_mm = 0;
    std::optional<ThinFeature> weakest;
    for (std::size_t i = 0; i < layer.places.size(); ++i) {
      const NarrowPlace& place = layer.places[i];
      if (place.kind != kind || !has_neighbour(print_layer, place)) continue;
      ThinFeature feature{place, LayerIndex{print_layer}, {}};
      if (model_) {
        const double enough = model_->to_middle(), dose = std::max(layer.dose[i], enough / 2);
        feature.latitude = kind == NarrowPlace::Kind::Wall ? 1 - enough / dose : enough / dose - 1;
        if (!weakest || is_weaker(feature, *weakest)) weakest = feature;
      }
      if (place.width_mm < kHairless * kFinestFeature_px * pitch_mm_) fine_mm += place.length_mm;
      if (!figures.narrowest || place.width_mm < figures.narrowest->place.width_mm) figures.narrowest = feature;
    }
    figures.fine_mm += fine_mm;
    figures.fine_layers += fine_mm > 0;
    if (!weakest) continue;
    if (!figures.weakest || is_weaker(*weakest, *figures.weakest)) figures.weakest = weakest;
    if (*weakest->latitude >= kDoseTolerance) continue;
    ++figures.weak_layers;
    report_.weak.push_back(*weakest);
  }
  if (print_layer > 0) layers_[print_layer - 1] = {};  // its successor was judged beside it
}

std::string to_json(const ThinReport& report) {
  using nlohmann::ordered_json;
  ordered_json weak = ordered_json::array();
  for (std::size_t i = 0; i < std::min(kMostListed, report.weak.size()); ++i) {
    ordered_json value = json_of(report.weak[i]);
    value["kind"] = report.weak[i].place.kind == NarrowPlace::Kind::Wall ? "wall" : "gap";
    weak.push_back(std::move(value));
  }
  return json_text({{"dose_known", report.dose_known},
                    {"dose_tolerance", kDoseTolerance},
                    {"walls", json_of(report.walls)},
                    {"gaps", json_of(report.gaps)},
                    {"weak", std::move(weak)}});
}

}  // namespace telefab::fab
