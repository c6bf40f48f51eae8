// SPDX-License-Identifier: GPL-3.0-or-later
#include "mask_options.hpp"

#include <cmath>

namespace telefab::fab {

void declare_mask_options(VerbOptions& app, MaskOptions& o) {
  app.add("--masks", o.method,
          "how grey levels are found: cover (area of each pixel), blend (solved, each layer's own light), "
          "blend-stack (solved for the light of all layers)")
      .one_of({"cover", "blend", "blend-stack"})
      .shows_default();
  app.add("--mask-deadline-s", o.deadline_s,
          "most seconds for solving one mask, the rest of it keeps its cover; 0: no limit, same bytes on every run")
      .within(0.0, 3600.0)
      .shows_default();
  app.add("--mask-iterations", o.iterations, "steps of the solver").within(1, 1000).shows_default();
  app.add("--support-grey", o.support_grey, "light of supports as share of white; solved masks only")
      .within(0.05, 1.0)
      .shows_default();
  app.add("--cure-depth", o.cure_depth_layers,
          "layers that one exposure cures deep: times follow from resin and irradiance; 0: the profile's times")
      .within(0.0, 20.0)
      .shows_default();
  app.flag("--plain-undersides", o.plain_undersides,
           "blend-stack: give layers over a void their full light although later ones cure through them");
  app.add("--pattern", o.pattern,
          "how the inside is lit, blend-stack only: solid, checker (cells in turns), shell-core (a share of the "
          "light). Less light inside may warp less; the shape stays the same")
      .one_of({"solid", "checker", "shell-core"})
      .shows_default();
  app.add("--pattern-shell-mm", o.inside.shell_mm, "what lies nearer to the surface always gets all light")
      .within(0.001, 100.0)
      .shows_default();
  app.add("--pattern-cell-mm", o.inside.cell_mm, "side of the checker's cells").within(0.001, 100.0).shows_default();
  app.add("--pattern-core-share", o.inside.core_share, "light of shell-core's inside as share of white")
      .within(0.01, 1.0)
      .shows_default();
}

Result<void> apply(const MaskOptions& o, PlanOptions& plan) {
  const auto method = mask_method_from_name(o.method);
  if (!method) return tl::unexpected{method.error()};
  const auto pattern = inner_pattern_from_name(o.pattern);
  if (!pattern) return tl::unexpected{pattern.error()};
  plan.masks = *method;
  plan.pattern = o.inside;
  plan.pattern.kind = *pattern;
  plan.mask_deadline = std::chrono::nanoseconds{std::llround(o.deadline_s * 1e9)};
  plan.mask_iterations = o.iterations;
  plan.support_grey = o.support_grey;
  plan.cure_depth_layers = o.cure_depth_layers;
  plan.compensate_undersides = !o.plain_undersides;
  return plan.validate();
}

}  // namespace telefab::fab
