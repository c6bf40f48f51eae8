// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <cstdint>
#include <vector>

namespace telefab::fab {

/// How much a point sees of the pixels around it, along one axis: a pixel's box blurred by a Gaussian, for every
/// 1/1024 of a pixel. The weights of a point sum to one.
class SpotWeights {
 public:
  static constexpr int kNodes = 1024;

  /// 0.05 to 3.5 px.
  explicit SpotWeights(double spread_px);
  /// 8, 16 or 24 weights.
  [[nodiscard]] int taps() const { return taps_; }
  /// A point at `place` (pixels) sees pixels first to first + taps() - 1, with the weights of node `node`.
  struct Window {
    std::int32_t first;
    std::uint32_t node;
  };
  [[nodiscard]] Window window(double place_px) const;
  [[nodiscard]] const float* node(std::uint32_t n) const { return table_.data() + n * static_cast<std::size_t>(taps_); }

 private:
  int taps_;
  std::vector<float> table_;
};

}  // namespace telefab::fab
