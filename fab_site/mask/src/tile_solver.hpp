// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <algorithm>
#include <cmath>
#include <cstring>

#include "tile_problem.hpp"

namespace telefab::fab {

/// The solver's body; `Set` only keeps apart what is compiled for different instruction sets. Only arithmetic that is
/// inlined belongs here: a shared function must not come out in the larger set.
template <class Set>
struct TileSolver {
  static constexpr int kLanes = 8;
  using Lanes [[gnu::vector_size(32)]] = float;

  [[gnu::always_inline]] static inline Lanes load(const float* from) {
    Lanes lanes;
    std::memcpy(&lanes, from, sizeof lanes);
    return lanes;
  }
  [[gnu::always_inline]] static inline void store(float* to, const Lanes& lanes) {
    std::memcpy(to, &lanes, sizeof lanes);
  }
  [[gnu::always_inline]] static inline float sum(const Lanes& a) {
    return ((a[0] + a[4]) + (a[2] + a[6])) + ((a[1] + a[5]) + (a[3] + a[7]));
  }

  /// The dose at a spot: rows of the window weighted, then columns.
  template <int Blocks>
  static float dose_at(const TileProblem& p, const TileProblem::Spot& spot, const float* doses) {
    const float* wx = p.weights->node(spot.node_x);
    const float* wy = p.weights->node(spot.node_y);
    const float* row = doses + spot.offset;
    Lanes sums[Blocks]{};
    for (int i = 0; i < Blocks * kLanes; ++i, row += p.side)
      for (int b = 0; b < Blocks; ++b) sums[b] += load(row + b * kLanes) * wy[i];
    Lanes all = sums[0] * load(wx);
    for (int b = 1; b < Blocks; ++b) all += sums[b] * load(wx + b * kLanes);
    return sum(all);
  }

  template <int Blocks>
  static void spread(const TileProblem& p, const TileProblem::Spot& spot, float amount, float* onto) {
    const float* wy = p.weights->node(spot.node_y);
    float* row = onto + spot.offset;
    Lanes across[Blocks];
    for (int b = 0; b < Blocks; ++b) across[b] = load(p.weights->node(spot.node_x) + b * kLanes) * amount;
    for (int i = 0; i < Blocks * kLanes; ++i, row += p.side)
      for (int b = 0; b < Blocks; ++b) store(row + b * kLanes, load(row + b * kLanes) + across[b] * wy[i]);
  }

  /// One projected step; `momentum` looks ahead along the last one.
  static void step(TileProblem& p, float momentum) {
    const Lanes pull = Lanes{} + p.regular;
    for (int y = 0; y < p.side; ++y)
      for (int x = p.first[static_cast<std::size_t>(y)]; x < p.last[static_cast<std::size_t>(y)]; x += kLanes) {
        const std::size_t at = static_cast<std::size_t>(y * p.side + x);
        const Lanes ahead = load(&p.ahead[at]), old = load(&p.dose[at]);
        Lanes now = ahead - (load(&p.slope[at]) + pull * (ahead - load(&p.reference[at]))) / load(&p.steepness[at]);
        const Lanes least = load(&p.least[at]), most = load(&p.most[at]);
        now = now < least ? least : now;
        now = now > most ? most : now;
        store(&p.dose[at], now);
        store(&p.ahead[at], now + (now - old) * momentum);
        store(&p.slope[at], Lanes{});
      }
  }

  template <int Blocks>
  static double run(TileProblem& p, int iterations) {
    for (const auto& spot : p.spots) spread<Blocks>(p, spot, spot.weight, p.steepness.data());
    double t = 1;
    for (int i = 0; i < iterations; ++i) {
      for (const auto& spot : p.spots)
        spread<Blocks>(p, spot, spot.weight * (dose_at<Blocks>(p, spot, p.ahead.data()) - p.target), p.slope.data());
      const double next = (1 + std::sqrt(1 + 4 * t * t)) / 2;
      step(p, static_cast<float>((t - 1) / next));
      t = next;
    }
    double squares = 0;
    for (const auto& spot : p.spots)
      if (spot.inside_core > 0) {
        const float off = dose_at<Blocks>(p, spot, p.dose.data()) - p.target;
        squares += static_cast<double>(spot.inside_core * off * off);
      }
    return squares;
  }

  static double solve(TileProblem& p, int iterations) {
    switch (p.weights->taps()) {
      case 8:
        return run<1>(p, iterations);
      case 16:
        return run<2>(p, iterations);
      default:
        return run<3>(p, iterations);
    }
  }
};

}  // namespace telefab::fab
