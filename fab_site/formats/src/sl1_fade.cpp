// SPDX-License-Identifier: GPL-3.0-or-later
#include "sl1_fade.hpp"

#include <algorithm>
#include <cmath>

namespace telefab::fab {
namespace {

constexpr double kSame = 1e-3;  // what three decimals of a second leave of a short exposure

double planned_s(const PlannedLayer& layer) { return std::chrono::duration<double>(layer.exposure).count(); }

}  // namespace

double faded_exposure_s(FadeReader reader, double first_s, double normal_s, std::uint32_t fade, std::uint32_t layer) {
  const double n = fade, i = layer, fall = first_s - normal_s;
  switch (reader) {
    case FadeReader::Slafw:
      return layer + 1 >= fade ? normal_s : first_s - fall * i / (n - 1);
    case FadeReader::Slafw2022:
      return first_s - fall * std::clamp(i - 2, 0.0, n) / n;
    case FadeReader::Odyssey:
      return layer >= fade ? normal_s : normal_s + fall * (n - i) / n;
  }
  return normal_s;
}

std::uint32_t fitted_fade(FadeReader reader, const PrintPlan& plan, double first_s, double normal_s) {
  if (first_s == normal_s || first_s <= 0 || normal_s <= 0) return kLeastFade;
  std::uint32_t best = kLeastFade;
  double least = std::numeric_limits<double>::infinity();
  for (std::uint32_t fade = kLeastFade; fade <= kMostFade; ++fade) {
    double sum = 0;
    // Behind the longest fade every one gives the normal exposure.
    for (std::size_t i = 0; i < std::min<std::size_t>(plan.layers.size(), kMostFade + 3); ++i) {
      const double planned = planned_s(plan.layers[i]);
      if (planned <= 0) continue;
      const double off =
          std::log(faded_exposure_s(reader, first_s, normal_s, fade, static_cast<std::uint32_t>(i)) / planned);
      sum += off * off;
    }
    if (sum < least - 1e-12) least = sum, best = fade;
  }
  return best;
}

std::vector<FadedLayers> faded_layers(const PrintPlan& plan, double first_s, double normal_s, std::uint32_t fade) {
  std::vector<FadedLayers> all;
  for (const FadeReader reader : {FadeReader::Slafw, FadeReader::Slafw2022, FadeReader::Odyssey}) {
    FadedLayers of{reader, {}, 0};
    for (const PlannedLayer& layer : plan.layers) {
      const double planned = planned_s(layer);
      if (planned <= 0) continue;
      const double made = faded_exposure_s(reader, first_s, normal_s, fade, layer.index.count());
      const double error = std::abs(made - planned) / planned;
      if (error <= kSame) continue;
      of.layers.push_back({layer.index, planned, made});
      of.most_error = std::max(of.most_error, error);
    }
    all.push_back(std::move(of));
  }
  return all;
}

}  // namespace telefab::fab
