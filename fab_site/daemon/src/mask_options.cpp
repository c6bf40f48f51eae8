// SPDX-License-Identifier: GPL-3.0-or-later
#include "mask_options.hpp"

#include <CLI/CLI.hpp>
#include <cmath>

namespace telefab::fab {

void declare_mask_options(CLI::App& app, MaskOptions& o) {
  app.add_option("--masks", o.method,
                 "how grey levels are found: cover (area of each pixel), blend (solved, each layer's own light), "
                 "blend-stack (solved for the light of all layers)")
      ->check(CLI::IsMember({"cover", "blend", "blend-stack"}))
      ->capture_default_str();
  app.add_option(
         "--mask-deadline-s", o.deadline_s,
         "most seconds for solving one mask, the rest of it keeps its cover; 0: no limit, same bytes on every run")
      ->check(CLI::Range(0.0, 3600.0))
      ->capture_default_str();
  app.add_option("--mask-iterations", o.iterations, "steps of the solver")
      ->check(CLI::Range(1, 1000))
      ->capture_default_str();
  app.add_option("--support-grey", o.support_grey, "light of supports as share of white; solved masks only")
      ->check(CLI::Range(0.05, 1.0))
      ->capture_default_str();
  app.add_option("--cure-depth", o.cure_depth_layers,
                 "layers that one exposure cures deep: times follow from resin and irradiance; 0: the profile's times")
      ->check(CLI::Range(0.0, 20.0))
      ->capture_default_str();
  app.add_flag("--plain-undersides", o.plain_undersides,
               "blend-stack: give layers over a void their full light although later ones cure through them");
  app.add_option("--pattern", o.pattern,
                 "how the inside is lit, blend-stack only: solid, checker (cells in turns), shell-core (a share of the "
                 "light). Less light inside may warp less; the shape stays the same")
      ->check(CLI::IsMember({"solid", "checker", "shell-core"}))
      ->capture_default_str();
  app.add_option("--pattern-shell-mm", o.inside.shell_mm, "what lies nearer to the surface always gets all light")
      ->check(CLI::Range(0.001, 100.0))
      ->capture_default_str();
  app.add_option("--pattern-cell-mm", o.inside.cell_mm, "side of the checker's cells")
      ->check(CLI::Range(0.001, 100.0))
      ->capture_default_str();
  app.add_option("--pattern-core-share", o.inside.core_share, "light of shell-core's inside as share of white")
      ->check(CLI::Range(0.01, 1.0))
      ->capture_default_str();
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
