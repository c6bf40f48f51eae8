// SPDX-License-Identifier: GPL-3.0-or-later
#include <fmt/format.h>

#include <cmath>
#include <telefab/fab/planning/plan_job.hpp>
#include <telefab/machine/exposure_time.hpp>

namespace telefab::fab {

Result<void> PlanOptions::validate() const {
  if (threads < 0 || threads > 1024)
    return fail(ErrorCode::InvalidInput, fmt::format("{} threads; 0 (all cores) to 1024 are possible", threads));
  if (mask_iterations < 1 || mask_iterations > 1000)
    return fail(ErrorCode::InvalidInput, fmt::format("{} mask iterations; 1 to 1000 are possible", mask_iterations));
  if (mask_deadline.count() < 0) return fail(ErrorCode::InvalidInput, "a mask deadline cannot be negative");
  if (!(support_grey > 0 && support_grey <= 1))
    return fail(ErrorCode::InvalidInput,
                fmt::format("a support grey of {}; above 0 and up to 1 is possible", support_grey));
  if (!(cure_depth_layers >= 0 && cure_depth_layers <= 20))
    return fail(ErrorCode::InvalidInput,
                fmt::format("a cure depth of {} layers; up to 20 are possible", cure_depth_layers));
  if (auto ok = pattern.validate(); !ok) return ok;
  if (pattern.kind != InnerPattern::Kind::Solid && masks != MaskMethod::BlendStack)
    return fail(
        ErrorCode::InvalidInput,
        fmt::format("the pattern {} needs masks by blend-stack, which take account of the light of later layers; "
                    "they are by {}",
                    name_of(pattern.kind), name_of(masks)));
  if (ready && (ready->layers.empty() || !ready->masks || !(ready->thickness_mm > 0)))
    return fail(ErrorCode::InvalidInput, "a ready print without layers, masks or thickness");
  if (ready && (masks != MaskMethod::Cover || supports.mode != SupportOptions::Mode::None || cure_depth_layers != 0))
    return fail(ErrorCode::InvalidInput,
                "a ready print is printed as it is: its masks count as by cover, and neither supports nor a cure depth "
                "can be asked for");
  return supports.validate();
}

Result<MachineProfile> exposed_to_depth(MachineProfile machine, double cure_depth_layers) {
  if (cure_depth_layers == 0) return machine;
  auto& layers = machine.layers;
  const double irradiance = machine.projection.irradiance_mw_per_cm2 * layers.light_share,
               critical = machine.resin.critical_dose_mj_per_cm2;
  if (!(irradiance > 0 && critical > 0 && machine.resin.penetration_mm > 0 && layers.exposure_s > 0))
    return fail(ErrorCode::InvalidInput,
                fmt::format("machine {} has no figures for resin and light; a cure depth needs "
                            "resin.critical_dose_mj_per_cm2, resin.penetration_mm and projection.irradiance_mw_per_cm2",
                            machine.name));
  const double dose = critical * std::exp(cure_depth_layers * layers.thickness_mm / machine.resin.penetration_mm);
  const double exposure_s = dose / irradiance, longer = exposure_s / layers.exposure_s;
  layers.bottom_exposure_s = timed_exposure_s(machine, layers.bottom_exposure_s * longer);
  layers.exposure_s = timed_exposure_s(machine, exposure_s);
  return machine;
}

}  // namespace telefab::fab
