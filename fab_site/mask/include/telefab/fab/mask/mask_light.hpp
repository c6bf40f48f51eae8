// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <array>
#include <telefab/base/result.hpp>
#include <telefab/machine/machine_profile.hpp>

namespace telefab::fab {

/// What light and resin do, as far as grey levels depend on it. Doses are in units of the resin's critical dose Ec.
struct MaskLight {
  double spread_px = 0.5;                 ///< sigma of one pixel's Gaussian light spot
  double white = 2;                       ///< dose of a white area in one normal exposure
  double layer_mm = 0.05;                 ///< L
  double penetration_mm = 0.1;            ///< Dp
  std::array<double, 256> tone{};         ///< irradiance of each grey, leak to 1; never falls
  MachineProfile::Projection projection;  ///< for its field

  /// exp(-L / Dp): the share of a dose that passes one layer.
  [[nodiscard]] double passed() const;
  /// Share of a white dose that cures a layer down to its middle: where the edge of a single exposure lies.
  [[nodiscard]] double threshold() const;
  /// Share of a white dose that cures a layer all the way through.
  [[nodiscard]] double through() const;
};

/// From a machine's profile: the white dose is its irradiance for its normal exposure. Fails with InvalidInput where a
/// figure is not finite and positive or the spread is not 0.05 to 3.5 px; names the key.
[[nodiscard]] Result<MaskLight> mask_light(const MachineProfile& machine);

/// Finds the grey whose irradiance is nearest to what is wanted.
class GreyEncoder {
 public:
  explicit GreyEncoder(const std::array<double, 256>& tone);
  /// `irradiance` as share of white; what is out of range gets black or white.
  [[nodiscard]] std::uint8_t operator()(float irradiance) const;

 private:
  static constexpr int kSlots = 4096;
  std::array<float, 256> upto_{};  ///< irradiance halfway to the next grey
  std::array<std::uint8_t, kSlots + 1> first_{};
};

}  // namespace telefab::fab
