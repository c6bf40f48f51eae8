// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <chrono>
#include <cstdint>
#include <optional>
#include <string>
#include <telefab/base/digest.hpp>
#include <telefab/base/quantity.hpp>
#include <telefab/fab/mask/mask_method.hpp>
#include <telefab/fab/print/layer_motion.hpp>
#include <telefab/machine/machine_profile.hpp>
#include <vector>

namespace telefab::fab {

/// One exposure of the print: which mask, how long, with the platform at which height.
struct PlannedLayer {
  LayerIndex index;                       ///< of the print: 0 lies on the platform, supports' base included
  double z_mm = 0;                        ///< gap between platform and vat during the exposure: (index + 1) * thickness
  std::chrono::microseconds exposure{0};  ///< finite and positive, or zero: an empty layer is passed without light
  Digest mask;                            ///< SHA-256 of the mask's grey bytes, row-major
  LayerMotion motion;                     ///< to this layer and from it
  double light_share = 1;                 ///< of full light, (0, 1]
  /// What gives the same dose at full light.
  [[nodiscard]] std::chrono::nanoseconds exposure_at_full_light() const {
    if (light_share == 1) return exposure;
    return std::chrono::nanoseconds{
        static_cast<std::int64_t>(static_cast<double>(std::chrono::nanoseconds{exposure}.count()) * light_share)};
  }
  friend bool operator==(const PlannedLayer&, const PlannedLayer&) = default;
};

/// Everything the print machine needs to know about a job before it starts.
struct PrintPlan {
  std::string job;
  std::string machine;
  /// How the masks were made; none: planned by a version that did not say.
  std::optional<MaskMethod> masks;
  Digest profile;  ///< digest_of_light of the machine it was planned for; zero: of a version that did not keep it
  PixelSize mask_size;
  double z_travel_mm = 0;
  double acceleration_mm_per_s2 = 0;  ///< of the axis, for estimates; 0: not stated
  std::vector<PlannedLayer> layers;
  friend bool operator==(const PrintPlan&, const PrintPlan&) = default;
  /// Conflict, with what to do, where the machine is no longer the one it was planned for.
  [[nodiscard]] Result<void> fits(const MachineProfile& now) const;
  /// Layers in order, z rising and within travel, exposures finite. InvalidInput names the layer.
  [[nodiscard]] Result<void> validate() const;
};

/// Canonical JSON: same plan, same bytes; those of a plan that does not state its masks are as they ever were. A plan
/// whose layers all lift and lower at one speed each and wait for rest alone, at full light, is
/// written as telefab-print-plan-1, any other as telefab-print-plan-2, which earlier versions refuse by name.
[[nodiscard]] std::string to_json(const PrintPlan& plan);
/// from_json(to_json(p)) == p. InvalidInput names the key, or a way to make masks that is
/// not known here; the plan is validated.
[[nodiscard]] Result<PrintPlan> print_plan_from_json(std::string_view text);
/// SHA-256 of to_json().
[[nodiscard]] Digest plan_digest(const PrintPlan& plan);

}  // namespace telefab::fab
