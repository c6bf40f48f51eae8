// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <span>
#include <vector>

namespace telefab::fab {

/// The light of one square pixel blurred by a Gaussian, along one axis and per unit of its irradiance:
///   k(t) = [erf((t + 1/2) / (sigma sqrt 2)) - erf((t - 1/2) / (sigma sqrt 2))] / 2,   t in pixels from its middle.
/// Tabulated for points at any fraction of a pixel; what lies beyond the reach is under 2e-6 of the whole, and the
/// weights that remain sum to one.
class PixelKernel {
 public:
  /// 0.05 to 5 px.
  explicit PixelKernel(double spread_px);

  /// By erf, without the table.
  [[nodiscard]] static double exact(double t_px, double spread_px);

  /// A point within pixel i sees pixels i - reach() to i + reach().
  [[nodiscard]] int reach() const { return reach_; }
  /// 2 reach() + 1 weights, then zeros up to a multiple of eight.
  [[nodiscard]] int padded() const { return padded_; }
  /// Weights, and their change per pixel of way, for a point at `fraction` (0 to 1) of its pixel; padded() each.
  void weights(double fraction, std::span<float> weights, std::span<float> slopes) const;

 private:
  int reach_;
  int padded_;
  std::vector<float> table_;   ///< node by node
  std::vector<float> slopes_;  ///< differences of neighbouring nodes, per pixel
};

}  // namespace telefab::fab
