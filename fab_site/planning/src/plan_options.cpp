// SPDX-License-Identifier: GPL-3.0-or-later
#include <fmt/format.h>

#include <cmath>
#include <nlohmann/json.hpp>
#include <telefab/fab/planning/plan_job.hpp>

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
    return fail(ErrorCode::InvalidInput,
                fmt::format("the pattern {} needs masks by blend-stack, which reckon with the light of later layers; "
                            "they are by {}",
                            name_of(pattern.kind), name_of(masks)));
  return supports.validate();
}

void MaskFigures::add(const MaskFigures& other) {
  length_px += other.length_px;
  squares_px3 += other.squares_px3;
  tiles += other.tiles;
  unsolved += other.unsolved;
}

double MaskFigures::residual_px() const { return length_px > 0 ? std::sqrt(squares_px3 / length_px) : 0; }

Result<MachineProfile> exposed_to_depth(MachineProfile machine, double cure_depth_layers) {
  if (cure_depth_layers == 0) return machine;
  auto& layers = machine.layers;
  const double irradiance = machine.projection.irradiance_mw_per_cm2, critical = machine.resin.critical_dose_mj_per_cm2;
  if (!(irradiance > 0 && critical > 0 && machine.resin.penetration_mm > 0 && layers.exposure_s > 0))
    return fail(ErrorCode::InvalidInput,
                fmt::format("machine {} has no figures for resin and light; a cure depth needs "
                            "resin.critical_dose_mj_per_cm2, resin.penetration_mm and projection.irradiance_mw_per_cm2",
                            machine.name));
  const double dose = critical * std::exp(cure_depth_layers * layers.thickness_mm / machine.resin.penetration_mm);
  layers.bottom_exposure_s *= dose / irradiance / layers.exposure_s;
  layers.exposure_s = dose / irradiance;
  return machine;
}

double layer_seconds(const MachineProfile::Motion& motion, std::chrono::microseconds exposure) {
  return std::chrono::duration<double>(exposure).count() + motion.lift_mm / motion.lift_speed_mm_per_s +
         motion.lift_mm / motion.lower_speed_mm_per_s + motion.settle_s;
}

std::string to_json(const PlanSummary& s) {
  using nlohmann::ordered_json;
  const ordered_json value{{"job", s.plan.job},
                           {"machine", s.plan.machine},
                           {"mask_px", {s.plan.mask_size.width_px, s.plan.mask_size.height_px}},
                           {"layers", s.plan.layers.size()},
                           {"part_layers", s.part_layers},
                           {"lift_layers", s.elevation_layers},
                           {"anchors", s.anchors},
                           {"anchors_under_floating", s.figures.floating},
                           {"repairs", s.repairs},
                           {"specks_darkened", s.specks},
                           {"to_support_mm2", s.figures.to_support_mm2},
                           {"part_mm3", s.figures.part_mm3},
                           {"support_mm3", s.figures.support_mm3},
                           {"cured_mm3", s.cured_mm3},
                           {"exposure_s", s.exposure_s},
                           {"print_s", s.print_s},
                           {"white_dose_mj_per_cm2", s.white_dose_mj_per_cm2},
                           {"cure_depth_mm", s.cure_depth_mm},
                           {"masks",
                            {{"method", name_of(s.masks)},
                             {"pattern", name_of(s.pattern.kind)},
                             {"iterations", s.mask_iterations},
                             {"contour_px", s.mask_figures.length_px},
                             {"residual_rms_px", s.mask_figures.residual_px()},
                             {"tiles_solved", s.mask_figures.tiles},
                             {"tiles_left_as_cover", s.mask_figures.unsolved},
                             {"deadline_reached", s.mask_figures.unsolved > 0}}},
                           {"thin", ordered_json::parse(to_json(s.thin))},
                           {"plan_digest", to_hex(plan_digest(s.plan))},
                           {"check", ordered_json::parse(to_json(s.check))},
                           {"seconds", {{"supports", s.support_seconds}, {"masks", s.mask_seconds}}}};
  return value.dump(1) + "\n";
}

}  // namespace telefab::fab
