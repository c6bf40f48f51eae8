// SPDX-License-Identifier: GPL-3.0-or-later
#include <algorithm>
#include <cmath>
#include <telefab/fab/cure/pixel_kernel.hpp>

namespace telefab::fab {
namespace {

constexpr int kNodes = 512;  // linear between them: 5e-6 of a weight at half a pixel of spread

}  // namespace

double PixelKernel::exact(double t_px, double spread_px) {
  const double scale = 1 / (spread_px * std::sqrt(2.0));
  return (std::erf((t_px + 0.5) * scale) - std::erf((t_px - 0.5) * scale)) / 2;
}

PixelKernel::PixelKernel(double spread_px)
    : reach_{static_cast<int>(1 + 4.75 * spread_px)}, padded_{(2 * reach_ + 1 + 7) / 8 * 8} {
  const std::size_t row = static_cast<std::size_t>(padded_);
  table_.assign((kNodes + 1) * row, 0);
  slopes_.assign(kNodes * row, 0);
  std::vector<double> weights(row);
  for (int node = 0; node <= kNodes; ++node) {
    const double fraction = static_cast<double>(node) / kNodes;
    double sum = 0;
    for (int i = 0; i <= 2 * reach_; ++i)
      sum += weights[static_cast<std::size_t>(i)] = exact(fraction - (i - reach_ + 0.5), spread_px);
    for (int i = 0; i <= 2 * reach_; ++i)
      table_[static_cast<std::size_t>(node) * row + static_cast<std::size_t>(i)] =
          static_cast<float>(weights[static_cast<std::size_t>(i)] / sum);
  }
  for (std::size_t i = 0; i < slopes_.size(); ++i) slopes_[i] = (table_[i + row] - table_[i]) * kNodes;
}

void PixelKernel::weights(double fraction, std::span<float> weights, std::span<float> slopes) const {
  const double at = std::clamp(fraction, 0.0, 1.0) * kNodes;
  const int node = std::min(static_cast<int>(at), kNodes - 1);
  const float rest = static_cast<float>((at - node) / kNodes);
  const float* values = table_.data() + static_cast<std::ptrdiff_t>(node) * padded_;
  const float* changes = slopes_.data() + static_cast<std::ptrdiff_t>(node) * padded_;
  for (int i = 0; i < padded_; ++i) {
    weights[static_cast<std::size_t>(i)] = values[i] + rest * changes[i];
    slopes[static_cast<std::size_t>(i)] = changes[i];
  }
}

}  // namespace telefab::fab
