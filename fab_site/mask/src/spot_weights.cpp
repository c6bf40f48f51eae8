// SPDX-License-Identifier: GPL-3.0-or-later
#include "spot_weights.hpp"

#include <cmath>
#include <numbers>

namespace telefab::fab {

SpotWeights::SpotWeights(double spread_px) : taps_{spread_px <= 1.1 ? 8 : spread_px <= 2.2 ? 16 : 24} {
  const double scale = 1 / (spread_px * std::numbers::sqrt2);
  std::vector<double> weights(static_cast<std::size_t>(taps_));
  for (int n = 0; n <= kNodes; ++n) {
    // The point lies `fraction` behind the middle of pixel taps/2 - 1 of its window.
    const double fraction = static_cast<double>(n) / kNodes;
    double sum = 0;
    for (int i = 0; i < taps_; ++i) {
      const double t = fraction + taps_ / 2 - 1 - i;
      weights[static_cast<std::size_t>(i)] = std::erf((t + 0.5) * scale) - std::erf((t - 0.5) * scale);
      sum += weights[static_cast<std::size_t>(i)];
    }
    for (const double w : weights) table_.push_back(static_cast<float>(w / sum));
  }
}

SpotWeights::Window SpotWeights::window(double place_px) const {
  const double from_middle = place_px - 0.5;
  const double below = std::floor(from_middle);
  return {static_cast<std::int32_t>(below) - (taps_ / 2 - 1),
          static_cast<std::uint32_t>((from_middle - below) * kNodes + 0.5)};
}

}  // namespace telefab::fab
