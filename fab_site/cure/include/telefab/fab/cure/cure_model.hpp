// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <array>
#include <chrono>
#include <telefab/fab/mask/mask.hpp>
#include <telefab/machine/machine_profile.hpp>

namespace telefab::fab {

/// What light does to resin on one machine. Doses are in units of the resin's critical dose Ec: one cures.
///
/// Pixel j of grey c lights with u_j = field_j * tone[c]; a point p of the layer's newest side gets
///   E(p) = white_per_s * seconds * sum_j u_j k(x - x_j) k(y - y_j)        (k: PixelKernel)
/// and layer n, seen from its newest side (away from the platform, where the light comes from), carries
///   B_n = E_n + q B_{n+1},  q = exp(-layer / penetration)
/// because all later light came through it. It is cured from there down to min(layer, penetration * ln B_n).
/// Not in the model: oxygen, diffusion, scatter wider than the Gaussian, reciprocity, shrinkage.
struct CureModel {
  PixelSize mask;
  double pixel_pitch_mm = 0;
  double layer_mm = 0;
  double penetration_mm = 0;  ///< Dp
  double spread_px = 0;       ///< sigma of one pixel's Gaussian light spot
  double white_per_s = 0;     ///< dose of a white area in a second
  double leak = 0;            ///< tone[0]
  std::array<float, 256> tone{};
  MachineProfile::Projection projection;  ///< for its field

  /// exp(-layer / Dp): the share of a dose that passes one layer.
  [[nodiscard]] double passed() const;
  /// Dose from which a layer is cured all the way through, exp(layer / Dp).
  [[nodiscard]] double through() const { return 1 / passed(); }
  /// Dose from which a layer is cured down to its middle, exp(layer / 2 Dp).
  [[nodiscard]] double to_middle() const;
  /// What leaking pixels alone would build up in a tall print exposed like this; at one and above all resin sets.
  [[nodiscard]] double leaked_dose(std::chrono::nanoseconds exposure) const;
};

/// Fails with InvalidInput where a figure is not finite and positive or the spread is beyond 5 px; names the key.
[[nodiscard]] Result<CureModel> cure_model(const MachineProfile& machine);

/// One mask shown for some time.
struct MaskExposure {
  MaskView mask;
  std::chrono::nanoseconds lit{};
};

}  // namespace telefab::fab
