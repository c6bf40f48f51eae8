// SPDX-License-Identifier: GPL-3.0-or-later
#include <algorithm>
#include <cmath>
#include <telefab/machine/machine_profile.hpp>

namespace telefab {
namespace {

/// Strength and stiffness go as 1 - exp(-b (E / Ec - 1)) with the dose E. No value of b for a real resin was found: it
/// is assumed, and a print measures what follows from it.
constexpr double kRise = 0.5;
constexpr int kSlices = 64;

/// Bending strength of a section cured once, `depth` penetrations deep, over that of a full section of the same depth.
/// All fibres break at one strain; the outermost is the first.
double bending_share(double depth) {
  double area = 0, moment = 0;
  const auto at = [&](int i) { return depth * (i + 0.5) / kSlices; };
  const auto stiffness = [&](double z) { return 1 - std::exp(-kRise * (std::exp(depth - z) - 1)); };
  for (int i = 0; i < kSlices; ++i) area += stiffness(at(i)), moment += stiffness(at(i)) * at(i);
  const double middle = moment / area;
  double second = 0;
  for (int i = 0; i < kSlices; ++i) second += stiffness(at(i)) * (at(i) - middle) * (at(i) - middle);
  second *= depth / kSlices;
  return second / std::max(middle, depth - middle) / (depth * depth / 6);
}

}  // namespace

double MachineProfile::overhang_share() const {
  if (supports.overhang_share > 0) return supports.overhang_share;
  constexpr double kLeast = 0.05, kMost = 10;
  const double dose = projection.irradiance_mw_per_cm2 * layers.light_share * layers.exposure_s;
  const double depth = std::log(dose / resin.critical_dose_mj_per_cm2);
  if (!(depth > 0) || !(layers.thickness_mm > 0)) return kLeast;
  const double layers_deep = depth * resin.penetration_mm / layers.thickness_mm;
  return std::clamp(layers_deep * layers_deep * bending_share(depth), kLeast, kMost);
}

double MachineProfile::self_support_reach_mm(double attached_mm2) const {
  const double most = std::max(supports.self_support_most_mm, supports.self_support_mm);
  if (supports.self_support_mm > 0)
    return std::min(most, supports.self_support_mm *
                              (1 + supports.self_support_growth_per_mm * std::sqrt(std::max(0.0, attached_mm2))));
  return std::min(most, layers.thickness_mm * std::sqrt(overhang_share() * carried_demand() / 3));
}

}  // namespace telefab
