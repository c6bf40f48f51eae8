// SPDX-License-Identifier: GPL-3.0-or-later
#include <nlohmann/json.hpp>
#include <telefab/base/json_text.hpp>
#include <telefab/fab/planning/plan_job.hpp>

namespace telefab::fab {

std::string to_json(const PlanSummary& s) {
  using nlohmann::ordered_json;
  ordered_json calibration;  // null where nobody measured
  if (s.calibration)
    calibration = {{"cure_depth_95_mm", {s.calibration->least_depth_mm, s.calibration->most_depth_mm}},
                   {"dose_95_share", s.calibration->dose_share}};
  ordered_json cost;  // null where the resin has no price
  if (s.price)
    cost = {{"amount", s.price->of_ml(s.resin_ml())},
            {"currency", s.price->currency},
            {"per_litre", s.price->per_litre},
            {"resin_ml", s.resin_ml()}};
  const ordered_json value{
      {"job", s.plan.job},
      {"machine", s.plan.machine},
      {"mask_px", {s.plan.mask_size.width_px, s.plan.mask_size.height_px}},
      {"layers", s.plan.layers.size()},
      {"part_layers", s.part_layers},
      {"lift_layers", s.elevation_layers},
      {"anchors", s.anchors.size()},
      {"anchors_under_floating", s.figures.floating},
      {"repairs", s.repairs},
      {"specks_darkened", s.specks},
      {"to_support_mm2", s.figures.to_support_mm2},
      {"part_mm3", s.figures.part_mm3},
      {"support_mm3", s.figures.support_mm3},
      {"cured_mm3", s.cured_mm3},
      {"cost", cost},
      {"exposure_s", s.exposure_s},
      {"print_s", s.print_s},
      {"white_dose_mj_per_cm2", s.white_dose_mj_per_cm2},
      {"cure_depth_mm", s.cure_depth_mm},
      {"calibration", calibration},
      {"masks",
       {{"method", name_of(s.masks)},
        {"pattern", name_of(s.pattern.kind)},
        {"iterations", s.mask_iterations},
        {"contour_px", s.mask_figures.length_px},
        {"residual_rms_px", s.mask_figures.residual_px()},
        {"tiles_solved", s.mask_figures.tiles},
        {"tiles_left_as_cover", s.mask_figures.unsolved},
        {"deadline_reached", s.mask_figures.unsolved > 0}}},
      {"thin", parsed_json(to_json(s.thin))},
      {"plan_digest", to_hex(plan_digest(s.plan))},
      {"check", parsed_json(to_json(s.check))},
      {"carry", parsed_json(to_json(s.carry))},
      {"seconds", {{"supports", s.support_seconds}, {"masks", s.mask_seconds}, {"carry", s.carry_seconds}}}};
  return json_text(value, 1) + "\n";
}

}  // namespace telefab::fab
